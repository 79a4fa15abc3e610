"""What a function of Python returns, as C: a value, or records written through pointers."""

from __future__ import annotations

import ast
from dataclasses import replace

from .assignment import Assignment
from .program import RestartError
from .types import (
    INTEGER,
    NATURAL,
    Array,
    RecordType,
    Scalar,
    Static,
    TableType,
    Type,
    Value,
    at_run_time,
    joined,
    shown,
)


class FunctionResults(Assignment):
    """What `function.Translator` knows of results."""

    arguments: list[tuple[str, Type]]

    def _return(self, node: ast.AST, value: Value) -> bool:
        t = value.type
        if isinstance(t, RecordType) and t.kind is None and value.parts is not None:
            t = RecordType(None, tuple(part.type for part in value.parts))
        if isinstance(t, Static):
            raise self.refused(
                node, "it returns a function or a class", "return numbers and named tuples"
            )
        if self.result is None:
            self.begin_result(t)
        elif (both := self._joined_result(self.result, t)) is None:
            raise self.refused(
                node,
                f"it returns {shown(t)}, elsewhere {shown(self.result)}",
                "return one type everywhere: 0.0 for 0",
            )
        elif both != self.result:
            raise RestartError("return")
        if self.outputs:
            self._write_outputs(value)
            self.emit("return;")
        else:
            self.emit(f"return {self.bare(value.code)};" if at_run_time(t) else "return;")
        return True

    def _joined_result(self, a: Type, b: Type) -> Type | None:
        if (
            isinstance(a, RecordType)
            and isinstance(b, RecordType)
            and a.kind is None
            and b.kind is None
        ):
            types = [joined(x, y) for x, y in zip(a.types, b.types, strict=False)]
            if len(a.types) != len(b.types) or None in types:
                return None
            return RecordType(None, tuple(types))  # type: ignore[arg-type]
        return joined(a, b)

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
                raise self.refused(self.tree, "it returns a table", "return its elements")
            if at_run_time(inner):
                self.outputs.append((self.local(f"result_{i}") if plain else "result", inner))

    def _write_outputs(self, value: Value) -> None:
        assert isinstance(value.type, RecordType)
        items = [value] if value.type.kind is not None else self.fields(value)
        live = [item for item in items if at_run_time(item.type)]
        if self.arguments and self.arguments[0][1] == self.outputs[0][1]:
            live[0] = self._read_before(live[0], self.arguments[0][0], f"(*{self.outputs[0][0]})")
        for (c, _), item in zip(self.outputs, live, strict=True):
            if item.code != f"(*{c})":
                self.store(f"(*{c})", item)

    def _read_before(self, value: Value, given: str, place: str) -> Value:
        """Return a record whose numbers are read from an argument before the record is written over it."""
        t = value.type
        if not isinstance(t, RecordType) or value.parts is None:
            return value
        parts = []
        for i, part in enumerate(value.parts):
            field = self.place_of(place, t, i)
            own = field.replace(self.outputs[0][0], given, 1)
            if part.parts is not None:
                part = self._read_before(part, given, field)
            elif isinstance(part.type, Scalar) and self.mentions(part, given) and part.code != own:
                part = self.copied(part, t.names[i])
            parts.append(part)
        return replace(value, parts=tuple(parts))
