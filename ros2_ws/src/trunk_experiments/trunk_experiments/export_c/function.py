"""One function of Python, statement by statement, as C for arguments of given types."""

from __future__ import annotations

import ast
from collections.abc import Sequence

from .body import LocalVariable
from .layout import (
    CodeBlock,
    Line,
    build_in_output,
    declare,
    may_write_in_place,
    text_of,
    without_unread,
)
from .loops import for_loop
from .program import Translated, first_line
from .results import FunctionResults
from .types import (
    INTEGER,
    NATURAL,
    NOTHING,
    RecordType,
    Type,
    Value,
    at_run_time,
)


class Translator(FunctionResults):
    """Translates one function; `Program.function` calls `run`, again after each `RestartError`."""

    # The function --------------------------------------------------------------------------------------

    def run(self) -> None:
        """Translate the function. Raises UntranslatableError, RestartError."""
        a = self.tree.args
        if a.vararg or a.kwarg:
            raise self.refused("it takes any number of arguments", "name each of them", a)
        for decorator in self.tree.decorator_list:
            raise self.refused("it is decorated", "leave the decorator out", decorator)
        for argument, t in zip([*a.posonlyargs, *a.args, *a.kwonlyargs], self.types, strict=True):
            self._parameter(argument.arg, t)
        if not self.statements(self.tree.body):
            self._return(Value(NOTHING))

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
        head = [f"/* {source}: {first_line(self.python)} */", f"static {self.head(f)} {{"]
        f.text = "\n".join([*head, *text_of(self.root), "}"])
        return f

    def head(self, f: Translated) -> str:
        """Return a function's head."""
        declared, items = self.program.declared, []
        for c, t in f.arguments:
            items.append(
                f"const {declared(t, f'*{c}')}" if isinstance(t, RecordType) else declared(t, c)
            )
        takes = ", ".join([*items, *(declared(t, f"*{c}") for c, t in f.outputs)]) or "void"
        if f.outputs or not at_run_time(f.result):
            return f"void {f.name}({takes})"
        return f"{declared(f.result, f.name)}({takes})"

    # Statements: True if control does not go on behind them ---------------------------------------------

    def statements(self, body: Sequence[ast.stmt]) -> bool:
        """Translate statements until one of them always leaves."""
        return any(self.at(node, self._statement) for node in body)

    def _statement(self, node: ast.stmt) -> bool:
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
                return self._return(value)
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
                    raise self.refused("it leaves a loop that is unrolled", "loop over a range")
                self.emit("break;" if isinstance(node, ast.Break) else "continue;")
                return True
            case _:
                raise self.outside(node)
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
            raise self.refused("a loop has an else", "set a bool in the loop", node.test)
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
