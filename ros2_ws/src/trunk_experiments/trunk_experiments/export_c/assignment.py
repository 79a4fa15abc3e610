"""Assignments of Python as C: names and their types, tuples, elements of arrays."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import replace

from .body import LocalVariable
from .expressions import Expressions
from .layout import words_in
from .program import RestartError
from .types import (
    INTEGER,
    NATURAL,
    Array,
    RecordType,
    Scalar,
    TableType,
    Value,
    at_run_time,
    joined,
    shown,
)


class Assignment(Expressions):
    """What `function.Translator` knows of assignments."""

    statements: Callable[[Sequence[ast.stmt]], bool]

    # Assignment ----------------------------------------------------------------------------------------

    def _assign(self, targets: Sequence[ast.expr], node: ast.expr) -> None:
        if len(targets) == 1 and isinstance(targets[0], ast.Tuple) and isinstance(node, ast.Tuple):
            self._assign_parallel(targets[0], node)
            return
        value = self.alone(node, targets[0] if len(targets) == 1 else None)
        if len(targets) > 1 and value.code and not value.is_known:
            value = self.in_memory(value, "value")
        for target in targets:
            self.assign(target, value)

    def _assign_parallel(self, target: ast.Tuple, node: ast.Tuple) -> None:
        names = {n.id for n in ast.walk(target) if isinstance(n, ast.Name)}
        names = {self.variables[n].value.code for n in names if n in self.variables}
        writes = any(isinstance(t, ast.Subscript) for t in target.elts)
        held = []
        for i, item in enumerate(self.fields(self.expression(node))):
            changes = any(self.mentions(item, n) for n in names) or (writes and "[" in item.code)
            if i and changes and at_run_time(item.type) and not item.is_known:
                item = self.copied(item, "value")
            held.append(item)
        self._unpack(target, held)

    def _unpack(self, target: ast.Tuple | ast.List, items: list[Value]) -> None:
        if len(items) != len(target.elts) or ast.Starred in map(type, target.elts):
            raise self.refused("it unpacks no tuple of this length", "name each element", target)
        for single, item in zip(target.elts, items, strict=True):
            self.assign(single, item)

    def assign(self, target: ast.expr, value: Value) -> None:
        """Assign a value to a target of Python."""
        self.at(target, lambda node: self._assign_to(node, value))

    def _assign_to(self, target: ast.expr, value: Value) -> None:
        match target:
            case ast.Name(id=name):
                self._assign_name(name, value)
            case ast.Tuple() | ast.List():
                tuples = RecordType | TableType
                self._unpack(target, self.fields(value) if isinstance(value.type, tuples) else [])
            case ast.Subscript():
                array = self.expression(target.value)
                if not isinstance(array.type, Array):
                    raise self.refused("it changes what is no array", "make a new tuple")
                self.writes = True
                place = self.element(array, target.slice).code
                item = self.converted(value, array.type.element)
                self.emit(f"{place} = {self.bare(item.code)};")
            case _:
                raise self.refused("it changes an attribute", "use _replace, or a new named tuple")

    def _assign_name(self, name: str, value: Value) -> None:
        if name not in self.loads:
            return
        variable, t = self.variables.get(name), value.type
        if t == NATURAL and name in self.wider:
            t = INTEGER
        if variable is not None and not at_run_time(variable.type) and variable.type != t:
            if variable.block is not self.block:
                raise self.refused(f"it may be {shown(variable.type)}, too", "use another name")
            variable = None
        if variable is None:
            if not at_run_time(t) or self._stays(name, value):
                self.variables[name] = LocalVariable(t, replace(value, type=t), self.block)
                return
            if value.code in self.fresh and self.declared[value.code] == self.program.c_type(t):
                c = value.code  # what a call has just written is the variable
                self.fresh.discard(c)
            else:
                c = self.local(name)
                self.declared[c] = self.program.c_type(t)
            self.variables[name] = variable = LocalVariable(t, Value(t, c, place=True), self.block)
            if self.stores[name] == 1 and not self.loops:
                self.fixed.add(c)
        if (both := joined(variable.type, t)) is None:
            problem = f"it was {shown(variable.type)}, and becomes {shown(t)}"
            raise self.refused(problem, "keep one type in a variable: 0.0 for 0, another name")
        if both != variable.type:
            raise RestartError(name)
        if at_run_time(t) and value.code != variable.value.code:
            self.store(variable.value.code, value)

    def _stays(self, name: str, value: Value) -> bool:
        """Return True for a variable that is nothing but another name of a value."""
        if self.stores[name] != 1:
            return False
        if value.is_known:
            return True
        if isinstance(value.type, Scalar) or not value.place:
            return False
        root = words_in(value.code)[:1]
        return bool(root) and root[0] in self.fixed
