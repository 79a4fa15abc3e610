"""Expressions of Python as C: types, operators, names, tuples; `calls` has what is called."""

from __future__ import annotations

import ast
import builtins
from types import ModuleType
from typing import Any

import numpy as np

from .operators import Operators
from .types import (
    NOTHING,
    Array,
    RecordType,
    Static,
    TableType,
    Value,
    shown,
)

_WIDEST = 2**63


class Expressions(Operators):
    """What `function.Translator` knows of expressions."""

    def alone(self, node: ast.expr, target: ast.expr | None = None) -> Value:
        """Return the value of an expression that is all there is to a statement's right side."""
        if not isinstance(node, ast.Call):
            return self.expression(node)
        return self.at(node, lambda call: self.call(call, True, target))

    # Names, tuples, elements -----------------------------------------------------------------------------

    def _x_constant(self, node: ast.Constant) -> Value:
        if isinstance(node.value, int) and not -_WIDEST <= node.value < _WIDEST:
            raise self.refused("more than 64 bits", "use smaller numbers")
        return self.program.value(node.value)

    def _x_name(self, node: ast.Name) -> Value:
        if node.id in self.variables:
            value: Value = self.variables[node.id].value
            return value
        if self.stores[node.id] > 0:
            raise self.refused("it has no value yet", "assign it before")
        for names in (self.free, self.python.__globals__, vars(builtins)):
            if node.id in names:
                return self._outer(node, names[node.id], f"{self._module()}_{node.id.strip('_')}")
        raise self.refused("this name is not known", "define it at the module's level")

    def _module(self) -> str:
        module: str = self.python.__module__
        return module.rsplit(".", 1)[-1]

    def _outer(self, node: ast.expr, value: Any, name: str) -> Value:
        if isinstance(value, int) and not isinstance(value, bool):
            self._fitting(value)
            return self.program.known(value, ast.unparse(node))
        if isinstance(value, list | dict | set | bytearray | np.ndarray):
            raise self.refused("it may change", "use a tuple")
        return self.program.value(value, name)

    def _x_attribute(self, node: ast.Attribute) -> Value:
        owner = self.expression(node.value)
        t = owner.type
        if isinstance(t, Static):
            if not hasattr(t.value, node.attr):
                raise self.refused("there is no such attribute", "see its definition")
            value = getattr(t.value, node.attr)
            if isinstance(t.value, ModuleType | type) or not isinstance(value, int | float):
                return self._outer(node, value, node.attr)
            raise self.refused("a number outside may change", "use a constant of the module")
        if isinstance(t, RecordType) and t.kind is not None and node.attr in t.names:
            return self.fields(owner)[t.names.index(node.attr)]
        if t == NOTHING:
            raise self.refused("None has no attributes", "test with is None before")
        raise self.refused(f"an attribute of {shown(t)}", "use a named tuple's field")

    def _x_tuple(self, node: ast.Tuple) -> Value:
        parts: list[Value] = []
        for element in node.elts:
            if not isinstance(element, ast.Starred):
                parts.append(self.expression(element))
                continue
            value = self.expression(element.value)
            if not isinstance(value.type, RecordType | TableType):
                raise self.refused(
                    f"a star before {shown(value.type)}", "name each element", element
                )
            parts += self.fields(value)
        return self.made(None, parts)

    def _x_subscript(self, node: ast.Subscript) -> Value:
        value = self.expression(node.value)
        t = value.type
        if isinstance(node.slice, ast.Slice):
            if not isinstance(t, RecordType | TableType):
                raise self.refused(f"a slice of {shown(t)}", "use single elements")
            bounds = (node.slice.lower, node.slice.upper, node.slice.step)
            try:
                cut = slice(*(None if b is None else ast.literal_eval(b) for b in bounds))
            except ValueError:
                raise self.refused("a slice that is not known", "give literal bounds") from None
            return self.made(None, self.fields(value)[cut])
        if not isinstance(t, RecordType | TableType | Array):
            raise self.refused(f"an element of {shown(t)}", "use a tuple")
        return self.element(value, node.slice)
