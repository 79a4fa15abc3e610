"""One function of Python, statement by statement, as C for arguments of given types."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FunctionType

from .assignment import LocalVariable
from .layout import (
    CodeBlock,
    Line,
    build_in_output,
    declare,
    may_write_in_place,
    text_of,
    without_unread,
    words_in,
)
from .loops import for_loop
from .program import Definitions, Translated, first_line, qualified
from .results import FunctionResults
from .types import (
    INTEGER,
    NATURAL,
    NOTHING,
    RecordType,
    Type,
    UntranslatableError,
    Value,
    at_run_time,
)

_REMEDIES: dict[type[ast.AST], tuple[str, str]] = {
    ast.Try: ("exceptions are not translated", "test with if what would raise"),
    ast.Raise: ("exceptions are not translated", "hold the last command instead"),
    ast.Assert: ("an assertion raises", "leave it out"),
    ast.With: ("with is not translated", "compute from the arguments alone"),
    ast.FunctionDef: ("a function in a function", "move it to the module's level"),
    ast.ClassDef: ("a class in a function", "move it to the module's level"),
    ast.Global: ("it changes what is outside", "keep it in the memory"),
    ast.Nonlocal: ("it changes what is outside", "keep it in the memory"),
    ast.Import: ("it imports while it runs", "import at the top of the module"),
    ast.ImportFrom: ("it imports while it runs", "import at the top of the module"),
    ast.Delete: ("del is not translated", "leave it out"),
    ast.Match: ("match is not translated", "use if and elif"),
}


class Translator(FunctionResults):
    """Translates one function; `Program.function` calls `run`, again after each `RestartError`."""

    def __init__(
        self, program: Definitions, python: FunctionType, types: Sequence[Type], wider: set[str]
    ) -> None:
        self.program, self.python, self.types, self.wider = program, python, types, wider
        self.line = python.__code__.co_firstlineno
        self.tree = self._source()
        self.stores = Counter(
            node.id
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        )
        self.loads = {
            node.id
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
        }
        cells = [cell.cell_contents for cell in python.__closure__ or ()]
        self.free = dict(zip(python.__code__.co_freevars, cells, strict=True))
        self.variables: dict[str, LocalVariable] = {}
        self.declared: dict[str, str] = {}  # C types of local variables
        self.fixed: set[str] = set()  # C names whose values never change
        self.root = self.block = CodeBlock()
        self.fresh: set[str] = set()  # variables that nobody has named yet
        self.returning = False  # the call that follows is all that is returned
        self.loops = 0
        self.arguments: list[tuple[str, Type]] = []
        self.result: Type | None = None
        self.outputs: list[tuple[str, Type]] = []
        self.writes = False

    def _source(self) -> ast.FunctionDef:
        try:
            tree: ast.stmt | None = ast.parse(textwrap.dedent(inspect.getsource(self.python))).body[
                0
            ]
        except (OSError, SyntaxError, TypeError):
            tree = None
        if not isinstance(tree, ast.FunctionDef):
            name = self.python.__name__
            raise UntranslatableError(
                qualified(self.python), self.line, name, "it has no source of its own", "use def"
            )
        return tree

    def refused(self, node: ast.AST, problem: str, remedy: str) -> UntranslatableError:
        """Return the error for a construct."""
        line = self.line + getattr(node, "lineno", 1) - 1
        text = " ".join(ast.unparse(node).split())
        text = text if len(text) <= 80 else f"{text[:77]}..."
        return UntranslatableError(qualified(self.python), line, text, problem, remedy)

    # The function --------------------------------------------------------------------------------------

    def run(self) -> None:
        """Translate the function. Raises UntranslatableError, RestartError."""
        a = self.tree.args
        if a.vararg or a.kwarg:
            raise self.refused(
                self.tree.args, "it takes any number of arguments", "name each of them"
            )
        if self.tree.decorator_list:
            raise self.refused(
                self.tree.decorator_list[0], "it is decorated", "leave the decorator out"
            )
        for argument, t in zip([*a.posonlyargs, *a.args, *a.kwonlyargs], self.types, strict=True):
            self._parameter(argument.arg, t)
        if not self.statements(self.tree.body):
            self._return(self.tree, Value(NOTHING))

    def _parameter(self, name: str, t: Type) -> None:
        if name in self.wider and t == NATURAL:
            t = INTEGER
        if not at_run_time(t):
            self.variables[name] = LocalVariable(t, Value(t), self.root)
            return
        c = self.local(name)
        self.arguments.append((c, t))
        code = f"(*{c})" if isinstance(t, RecordType) else c
        self.variables[name] = LocalVariable(t, Value(t, code, place=True), self.root)
        if not self.stores[name]:
            self.fixed.add(c)
        elif isinstance(t, RecordType):  # the argument itself stays as it is
            own = self.temporary(t, name)
            self.emit(f"{own} = {code};", own)
            self.variables[name] = LocalVariable(t, Value(t, own, place=True), self.root)

    def local(self, name: str) -> str:
        """Return a C name for a local variable, its own in this function."""
        plain, count = self.program.local(name), 1
        taken = {n for n, _ in self.arguments} | set(self.declared)
        c = plain
        while c in taken:
            count += 1
            c = self.program.local(f"{plain}_{count}")
        return c

    def finished(self, name: str) -> Translated:
        """Return the function under this name, its variables declared."""
        f = Translated(self.python, name, self.arguments, self.result or NOTHING, self.outputs)
        f.writes = self.writes
        without_unread(self.root, self.declared)
        for c, _ in self.outputs:
            build_in_output(self.root, c, self.declared)
        if self.arguments and self.outputs and self.arguments[0][1] == self.outputs[0][1]:
            callees = {callee.name for callee in self.program.ordered if callee.in_place}
            given, output = self.arguments[0][0], self.outputs[0][0]
            f.in_place = may_write_in_place(self.root, given, output, callees)
        words = self.root.words()
        for unused in [c for c, _ in (*self.arguments, *self.outputs) if c not in words]:
            self.root.body.insert(0, Line(f"(void){unused};"))
        if self.root.body and getattr(self.root.body[-1], "text", "") == "return;":
            self.root.body.pop()
        declare(self.root, self.declared)
        source = f"{self.python.__module__}.{self.python.__qualname__}".replace(".<locals>", "")
        f.text = "\n".join(
            [
                f"/* {source}: {first_line(self.python)} */",
                f"static {self.head(f)} {{",
                *text_of(self.root),
                "}",
            ]
        )
        return f

    def head(self, f: Translated) -> str:
        """Return a function's head."""
        items = []
        for c, t in f.arguments:
            kind = self.program.c_type(t)
            if isinstance(t, RecordType):
                items.append(f"const {kind} *{c}")
            else:
                items.append(f"{kind}{c}" if kind.endswith("*") else f"{kind} {c}")
        items += [f"{self.program.c_type(t)} *{c}" for c, t in f.outputs]
        result = "void" if f.outputs or not at_run_time(f.result) else self.program.c_type(f.result)
        return (
            f"{result}{'' if result.endswith('*') else ' '}{f.name}({', '.join(items) or 'void'})"
        )

    # Lines ---------------------------------------------------------------------------------------------

    def emit(self, text: str, target: str = "", plain: bool = False) -> None:
        """Append a line; it sets ``target`` unless it reads it too."""
        read = words_in(text).count(target) > 1 if target else False
        self.block.body.append(Line(text, "" if read else target, plain and not read))

    @contextmanager
    def inside(self, block: CodeBlock, loop: bool = False) -> Iterator[CodeBlock]:
        """Append what follows to a block, which is not part of the function yet."""
        before, self.block = self.block, block
        self.loops += loop
        try:
            yield block
        finally:
            self.block = before
            self.loops -= loop

    def temporary(self, t: Type, hint: str) -> str:
        """Return a new local variable's C name."""
        c = self.local(hint)
        self.declared[c] = self.program.c_type(t)
        return c

    # Statements: True if control does not go on behind them ---------------------------------------------

    def statements(self, body: Sequence[ast.stmt]) -> bool:
        """Translate statements until one of them always leaves."""
        return any(self.statement(node) for node in body)

    def statement(self, node: ast.stmt) -> bool:
        """Translate a statement."""
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                return False
            case ast.Expr(value=ast.Call() as call):
                value = self.call(call, alone=True)
                if value.code and value.parts is None and not value.place:
                    self.emit(
                        f"(void){value.code};" if at_run_time(value.type) else f"{value.code};"
                    )
                return False
            case ast.Return():
                self.returning = isinstance(node.value, ast.Call)
                value = Value(NOTHING) if node.value is None else self.alone(node.value)
                self.returning = False
                return self._return(node, value)
            case ast.AnnAssign(value=None):
                return False
            case ast.AnnAssign(value=ast.expr() as value_node):
                self._assign([node.target], value_node)
            case ast.Assign():
                self._assign(node.targets, node.value)
            case ast.AugAssign():
                load = ast.parse(ast.unparse(node.target), mode="eval").body
                for part in ast.walk(load):
                    ast.copy_location(part, node.target)
                both = ast.copy_location(ast.BinOp(load, node.op, node.value), node)
                self._assign([node.target], both)
            case ast.If():
                return self._if(node)
            case ast.While():
                self._while(node)
            case ast.For():
                return for_loop(self, node)
            case ast.Break() | ast.Continue():
                if self.loops == 0:
                    raise self.refused(
                        node, "it leaves a loop that is unrolled", "loop over a range"
                    )
                self.emit("break;" if isinstance(node, ast.Break) else "continue;")
                return True
            case _:
                default = ("this statement is not translated", "use assignments, if, for and while")
                raise self.refused(node, *_REMEDIES.get(type(node), default))
        return False

    def _if(self, node: ast.If) -> bool:
        test = self.truth(node.test)
        if test.is_known:
            return self.statements(node.body if test.known else node.orelse)
        then = CodeBlock(f"if ({self.bare(test.code)}) {{")
        self.block.body.append(then)
        with self.inside(then):
            leaves = self.statements(node.body)
        if not node.orelse:
            return False
        other = CodeBlock("else {")
        with self.inside(other):
            leaves = self.statements(node.orelse) and leaves
        chain = [n.head for n in other.body if isinstance(n, CodeBlock)]
        if len(chain) == len(other.body) > 0 and chain[0].startswith("if (") and _one_if(chain):
            first = other.body[0]
            assert isinstance(first, CodeBlock)
            first.head = f"else {first.head}"
            self.block.body += other.body
        elif other.body:
            self.block.body.append(other)
        return leaves

    def _while(self, node: ast.While) -> None:
        if node.orelse:
            raise self.refused(node.test, "a loop has an else", "set a bool in the loop")
        loop = CodeBlock(loop=True)
        with self.inside(loop, loop=True):
            test = self.truth(node.test)
            if test.is_known and not test.known:
                return
            loop.head = "while (true) {" if test.is_known else f"while ({self.bare(test.code)}) {{"
            if loop.body:  # the test needs statements of its own
                loop.head = "for (;;) {"
                self.block.body.append(CodeBlock(f"if (!{test.code}) {{", [Line("break;")]))
            self.statements(node.body)
        self.block.body.append(loop)


def _one_if(heads: Sequence[str]) -> bool:
    return all(head.startswith("else") for head in heads[1:])
