"""What is known of a function while it is translated: names, blocks, results, and how values are stored."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FunctionType
from typing import Any, TypeVar

from .layout import CodeBlock, Line, words_in
from .program import Definitions, qualified
from .types import (
    INTEGER,
    INTEGERS,
    NATURAL,
    REAL,
    Array,
    RecordType,
    TableType,
    Type,
    UntranslatableError,
    Value,
    at_run_time,
    shown,
    stored,
)

Node = TypeVar("Node", bound=ast.AST)
T = TypeVar("T")
# What is outside the subset: the problem, and what to write instead.
_OUTSIDE: dict[tuple[type[ast.AST], ...], tuple[str, str]] = {
    (ast.List,): ("lists are not translated", "use a tuple of fixed length"),
    (ast.Dict,): ("dictionaries are not translated", "use a named tuple"),
    (ast.Set,): ("sets are not translated", "use comparisons"),
    (ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp): (
        "comprehensions are not translated",
        "write the elements, or a for loop",
    ),
    (ast.Lambda,): ("lambda is not translated", "use def at the module's level"),
    (ast.NamedExpr,): ("an assignment in an expression", "assign on a line of its own"),
    (ast.JoinedStr,): ("strings are not translated", "compute with numbers"),
    (ast.Await,): ("await is not translated", "compute from the arguments alone"),
    (ast.Yield, ast.YieldFrom): ("generators are not translated", "return a tuple"),
    (ast.Starred,): ("a star outside of a tuple", "name each element"),
    (ast.Try,): ("exceptions are not translated", "test with if what would raise"),
    (ast.Raise,): ("exceptions are not translated", "hold the last command instead"),
    (ast.Assert,): ("an assertion raises", "leave it out"),
    (ast.With,): ("with is not translated", "compute from the arguments alone"),
    (ast.FunctionDef,): ("a function in a function", "move it to the module's level"),
    (ast.ClassDef,): ("a class in a function", "move it to the module's level"),
    (ast.Global, ast.Nonlocal): ("it changes what is outside", "keep it in the memory"),
    (ast.Import, ast.ImportFrom): ("it imports while it runs", "import at the top of the module"),
    (ast.Delete,): ("del is not translated", "leave it out"),
    (ast.Match,): ("match is not translated", "use if and elif"),
    (ast.expr,): ("this expression is not translated", "use numbers and named tuples"),
    (ast.stmt,): ("this statement is not translated", "use assignments, if, for and while"),
}


@dataclass
class LocalVariable:
    """A local name of Python; ``value``: how it is read."""

    type: Type
    value: Value
    block: CodeBlock  # where it got this type


class FunctionBody:
    """A function that is being translated. Its parts, each in a module, are a class upon the other."""

    def __init__(
        self, program: Definitions, python: FunctionType, types: Sequence[Type], wider: set[str]
    ) -> None:
        self.program, self.python, self.types, self.wider = program, python, types, wider
        self.line = python.__code__.co_firstlineno
        self.tree = self._source()
        self.node: ast.AST = self.tree
        names = [node for node in ast.walk(self.tree) if isinstance(node, ast.Name)]
        self.stores = Counter(node.id for node in names if isinstance(node.ctx, ast.Store))
        self.loads = {node.id for node in names if isinstance(node.ctx, ast.Load)}
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
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(self.python))).body
            if isinstance(tree, ast.FunctionDef):
                return tree
        except (OSError, SyntaxError, TypeError):
            pass
        place = (qualified(self.python), self.line, self.python.__name__)
        raise UntranslatableError(*place, "it has no source of its own", "use def")

    def at(self, node: Node, translate: Callable[[Node], T]) -> T:
        """Translate a node; until it is done, `refused` is about that node."""
        before, self.node = self.node, node
        result = translate(node)
        self.node = before
        return result

    def refused(
        self, problem: str, remedy: str, node: ast.AST | None = None
    ) -> UntranslatableError:
        """Return the error for a construct, by default the one that is being translated."""
        node = node or self.node
        line = self.line + getattr(node, "lineno", 1) - 1
        text = " ".join(ast.unparse(node).split())
        text = text if len(text) <= 80 else f"{text[:77]}..."
        return UntranslatableError(qualified(self.python), line, text, problem, remedy)

    def outside(self, node: ast.AST) -> UntranslatableError:
        """Return the error for a kind of expression or statement that is never translated."""
        problem, remedy = next(v for k, v in _OUTSIDE.items() if isinstance(node, k))
        return self.refused(problem, remedy, node)

    def local(self, name: str) -> str:
        """Return a C name for a local variable, its own in this function."""
        plain, count = self.program.local(name), 1
        taken = {n for n, _ in self.arguments} | set(self.declared)
        c = plain
        while c in taken:
            count += 1
            c = self.program.local(f"{plain}_{count}")
        return c

    def temporary(self, t: Type, hint: str) -> str:
        """Return a new local variable's C name."""
        c = self.local(hint)
        self.declared[c] = self.program.c_type(t)
        return c

    def copied(self, value: Value, hint: str) -> Value:
        """Return a value in a new variable, safe from later assignments."""
        c = self.temporary(value.type, hint)
        self.store(c, value)
        return Value(value.type, c, place=True)

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

    def expression(self, node: ast.expr) -> Value:
        """Return an expression's value; statements that it needs are appended to the block."""
        handler = getattr(self, f"_x_{type(node).__name__.lower()}", None)
        if handler is None:
            raise self.outside(node)
        value: Value = self.at(node, handler)
        return value

    @staticmethod
    def bare(code: str) -> str:
        """Return code without brackets around all of it."""
        if not (code.startswith("(") and code.endswith(")")):
            return code
        depth = 0
        for i, character in enumerate(code):
            depth += (character == "(") - (character == ")")
            if depth == 0 and i < len(code) - 1:
                return code
        return code[1:-1]

    @staticmethod
    def tight(code: str) -> str:
        """Return code that a cast or a sign can stand before."""
        return (
            code
            if re.fullmatch(r"[\w.>\-\[\]]+|\(.*\)", code) and "-" not in code[:1]
            else f"({code})"
        )

    def mentions(self, value: Value, code: str) -> bool:
        """Return True if a value's code reads the variable that some code names."""
        if value.parts is not None:
            return any(self.mentions(part, code) for part in value.parts)
        root = words_in(code)[:1]
        return bool(root) and root[0] in words_in(value.code)

    def place_of(self, code: str, record: RecordType, i: int) -> str:
        """Return the code of a record's field."""
        name = self.program.field(record, i)
        return f"{code[2:-1]}->{name}" if re.fullmatch(r"\(\*\w+\)", code) else f"{code}.{name}"

    def fields(self, value: Value) -> list[Value]:
        """Return the elements of a tuple or a table."""
        t = value.type
        if value.parts is not None:
            return list(value.parts)
        if isinstance(t, TableType):
            return [Value(t.element, f"{value.code}[{i}]", place=True) for i in range(t.length)]
        assert isinstance(t, RecordType)
        return [
            Value(inner, self.place_of(value.code, t, i), place=True)
            if at_run_time(inner)
            else Value(inner)
            for i, inner in enumerate(t.types)
        ]

    def made(self, kind: type[Any] | None, parts: Sequence[Value]) -> Value:
        """Return a tuple of values."""
        return Value(
            RecordType(kind, tuple(stored(part.type) for part in parts)), parts=tuple(parts)
        )

    def converted(self, value: Value, to: Type) -> Value:
        """Return a number as another type, as arithmetic does it."""
        t = value.type
        if t == to or (t in INTEGERS and to in INTEGERS):
            return value
        if to == REAL and t in INTEGERS:
            if value.is_known and abs(value.known) <= 2**53:
                return Value(REAL, self.program.literal(float(value.known)))
            return Value(REAL, f"(double){self.tight(value.code)}")
        raise self.refused(f"{shown(t)} where {shown(to)} is needed", f"give {shown(to)}")

    def in_memory(self, value: Value, hint: str) -> Value:
        """Return a value that is in memory: a place, or a number's code."""
        if value.parts is None and (value.place or re.fullmatch(r"\w+", value.code)):
            return value
        return self.copied(value, hint) if at_run_time(value.type) else value

    def store(self, place: str, value: Value) -> None:
        """Append the assignment of a value to a place."""
        name = place if re.fullmatch(r"\w+", place) else ""
        if value.parts is None:
            left = place[1:-1] if place.startswith("(*") else place
            self.emit(f"{left} = {self.bare(value.code)};", name, bool(name))
            return
        if not self._kept(place, value) and self.mentions(value, place):
            value = self.copied(value, "next")
            self.emit(f"{place} = {value.code};", name, bool(name))
            return
        self._fill(place, value, name)

    def _kept(self, place: str, value: Value) -> bool:
        """Return True if all parts that read the place are its own fields, which keep their values."""
        assert isinstance(value.type, RecordType)
        return all(
            not self.mentions(part, place) or part.code == self.place_of(place, value.type, i)
            for i, part in enumerate(value.parts or ())
        )

    def _fill(self, place: str, value: Value, whole: str = "") -> None:
        assert isinstance(value.type, RecordType)
        for i, part in enumerate(value.parts or ()):
            field = self.place_of(place, value.type, i)
            if not at_run_time(part.type) or part.code == field:
                whole = ""
                continue
            if part.parts is not None:
                self._fill(field, part, whole)
            else:
                self.emit(f"{field} = {self.bare(part.code)};", whole)
            whole = ""

    def begin_result(self, t: Type) -> None:
        """Settle the type of the function's result."""
        self.result = INTEGER if t == NATURAL and "return" in self.wider else t
        if not isinstance(t, RecordType) or not at_run_time(t):
            return
        plain = t.kind is None
        if plain and "return" in self.wider:
            self.result = t = RecordType(
                None, tuple(INTEGER if x == NATURAL else x for x in t.types)
            )
        for i, inner in enumerate(t.types) if plain else [(0, t)]:
            if isinstance(inner, TableType | Array):
                raise self.refused("it returns a table", "return its elements", self.tree)
            if at_run_time(inner):
                self.outputs.append((self.local(f"result_{i}") if plain else "result", inner))
