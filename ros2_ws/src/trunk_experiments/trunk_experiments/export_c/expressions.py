"""Expressions of Python as C: types, operators, names, tuples; `calls` has what is called."""

from __future__ import annotations

import ast
import builtins
import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from types import ModuleType
from typing import Any

import numpy as np

from .layout import CodeBlock, words_in
from .operators import Operators
from .program import Definitions
from .types import (
    INTEGERS,
    NOTHING,
    REAL,
    Array,
    RecordType,
    Static,
    TableType,
    Type,
    UntranslatableError,
    Value,
    at_run_time,
    shown,
    stored,
)

_REMEDIES: dict[type[ast.AST], tuple[str, str]] = {
    ast.List: ("lists are not translated", "use a tuple of fixed length"),
    ast.Dict: ("dictionaries are not translated", "use a named tuple"),
    ast.Set: ("sets are not translated", "use comparisons"),
    ast.ListComp: ("comprehensions are not translated", "write the elements, or a for loop"),
    ast.GeneratorExp: ("comprehensions are not translated", "write the elements, or a for loop"),
    ast.SetComp: ("comprehensions are not translated", "write the elements, or a for loop"),
    ast.DictComp: ("comprehensions are not translated", "write the elements, or a for loop"),
    ast.Lambda: ("lambda is not translated", "use def at the module's level"),
    ast.NamedExpr: ("an assignment in an expression", "assign on a line of its own"),
    ast.JoinedStr: ("strings are not translated", "compute with numbers"),
    ast.Await: ("await is not translated", "compute from the arguments alone"),
    ast.Yield: ("generators are not translated", "return a tuple"),
    ast.YieldFrom: ("generators are not translated", "return a tuple"),
    ast.Starred: ("a star outside of a tuple", "name each element"),
}
_WIDEST = 2**63


class Expressions(Operators):
    """What `function.Translator` knows of expressions."""

    program: Definitions
    python: Any
    variables: dict[str, Any]
    free: dict[str, Any]
    stores: Counter[str]
    block: CodeBlock
    refused: Callable[[ast.AST, str, str], UntranslatableError]
    emit: Callable[..., None]
    inside: Callable[..., AbstractContextManager[CodeBlock]]
    temporary: Callable[[Type, str], str]
    copied: Callable[[Value, str], Value]

    # Pieces --------------------------------------------------------------------------------------------

    def expression(self, node: ast.expr) -> Value:
        """Return an expression's value; statements that it needs are appended to the block."""
        handler = getattr(self, f"_x_{type(node).__name__.lower()}", None)
        if handler is None:
            default = ("this expression is not translated", "use numbers and named tuples")
            raise self.refused(node, *_REMEDIES.get(type(node), default))
        value: Value = handler(node)
        return value

    def alone(self, node: ast.expr, target: ast.expr | None = None) -> Value:
        """Return the value of an expression that is all there is to a statement's right side."""
        return (
            self.call(node, True, target) if isinstance(node, ast.Call) else self.expression(node)
        )

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

    def in_memory(self, value: Value, hint: str) -> Value:
        """Return a value that is in memory: a place, or a number's code."""
        if value.parts is None and (value.place or re.fullmatch(r"\w+", value.code)):
            return value
        return self.copied(value, hint) if at_run_time(value.type) else value

    def made(self, kind: type[Any] | None, parts: Sequence[Value]) -> Value:
        """Return a tuple of values."""
        return Value(
            RecordType(kind, tuple(stored(part.type) for part in parts)), parts=tuple(parts)
        )

    def converted(self, value: Value, to: Type, node: ast.AST) -> Value:
        """Return a number as another type, as arithmetic does it."""
        t = value.type
        if t == to or (t in INTEGERS and to in INTEGERS):
            return value
        if to == REAL and t in INTEGERS:
            if value.is_known and abs(value.known) <= 2**53:
                return Value(REAL, self.program.literal(float(value.known)))
            return Value(REAL, f"(double){self.tight(value.code)}")
        raise self.refused(node, f"{shown(t)} where {shown(to)} is needed", f"give {shown(to)}")

    @staticmethod
    def tight(code: str) -> str:
        """Return code that a cast or a sign can stand before."""
        return (
            code
            if re.fullmatch(r"[\w.>\-\[\]]+|\(.*\)", code) and "-" not in code[:1]
            else f"({code})"
        )

    # Names, tuples, elements -----------------------------------------------------------------------------

    def _x_constant(self, node: ast.Constant) -> Value:
        if isinstance(node.value, int) and not -_WIDEST <= node.value < _WIDEST:
            raise self.refused(node, "more than 64 bits", "use smaller numbers")
        return self.program.value(node.value)

    def _x_name(self, node: ast.Name) -> Value:
        if node.id in self.variables:
            value: Value = self.variables[node.id].value
            return value
        if self.stores[node.id] > 0:
            raise self.refused(node, "it has no value yet", "assign it before")
        for names in (self.free, self.python.__globals__, vars(builtins)):
            if node.id in names:
                return self._outer(node, names[node.id], f"{self._module()}_{node.id.strip('_')}")
        raise self.refused(node, "this name is not known", "define it at the module's level")

    def _module(self) -> str:
        module: str = self.python.__module__
        return module.rsplit(".", 1)[-1]

    def _outer(self, node: ast.expr, value: Any, name: str) -> Value:
        if isinstance(value, int) and not isinstance(value, bool):
            return self.program.known(value, ast.unparse(node))
        if isinstance(value, list | dict | set | bytearray | np.ndarray):
            raise self.refused(node, "it may change", "use a tuple")
        return self.program.value(value, name)

    def _x_attribute(self, node: ast.Attribute) -> Value:
        owner = self.expression(node.value)
        t = owner.type
        if isinstance(t, Static):
            if not hasattr(t.value, node.attr):
                raise self.refused(node, "there is no such attribute", "see its definition")
            value = getattr(t.value, node.attr)
            if isinstance(t.value, ModuleType | type) or not isinstance(value, int | float):
                return self._outer(node, value, node.attr)
            raise self.refused(node, "a number outside may change", "use a constant of the module")
        if isinstance(t, RecordType) and t.kind is not None and node.attr in t.names:
            return self.fields(owner)[t.names.index(node.attr)]
        if t == NOTHING:
            raise self.refused(node, "None has no attributes", "test with is None before")
        raise self.refused(node, f"an attribute of {shown(t)}", "use a named tuple's field")

    def _x_tuple(self, node: ast.Tuple) -> Value:
        parts: list[Value] = []
        for element in node.elts:
            if not isinstance(element, ast.Starred):
                parts.append(self.expression(element))
                continue
            value = self.expression(element.value)
            if not isinstance(value.type, RecordType | TableType):
                raise self.refused(
                    element, f"a star before {shown(value.type)}", "name each element"
                )
            parts += self.fields(value)
        return self.made(None, parts)

    def _x_subscript(self, node: ast.Subscript) -> Value:
        value = self.expression(node.value)
        t = value.type
        if isinstance(node.slice, ast.Slice):
            if not isinstance(t, RecordType | TableType):
                raise self.refused(node, f"a slice of {shown(t)}", "use single elements")
            bounds = (node.slice.lower, node.slice.upper, node.slice.step)
            try:
                cut = slice(*(None if b is None else ast.literal_eval(b) for b in bounds))
            except ValueError:
                raise self.refused(
                    node, "a slice that is not known", "give literal bounds"
                ) from None
            return self.made(None, self.fields(value)[cut])
        if not isinstance(t, RecordType | TableType | Array):
            raise self.refused(node, f"an element of {shown(t)}", "use a tuple")
        return self.element(value, node)
