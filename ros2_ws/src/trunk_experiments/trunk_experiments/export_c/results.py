"""What a function of Python returns, as C: a value, or records written through pointers."""

from __future__ import annotations

from dataclasses import replace

from .assignment import Assignment
from .program import RestartError
from .types import (
    RecordType,
    Scalar,
    Static,
    Type,
    Value,
    at_run_time,
    joined,
    shown,
)


class FunctionResults(Assignment):
    """What `function.Translator` knows of results."""

    def _return(self, value: Value) -> bool:
        t = value.type
        if isinstance(t, RecordType) and t.kind is None and value.parts is not None:
            t = RecordType(None, tuple(part.type for part in value.parts))
        if isinstance(t, Static):
            raise self.refused(
                "it returns a function or a class", "return numbers and named tuples"
            )
        if self.result is None:
            self.begin_result(t)
        elif (both := self._joined_result(self.result, t)) is None:
            problem = f"it returns {shown(t)}, elsewhere {shown(self.result)}"
            raise self.refused(problem, "return one type everywhere: 0.0 for 0")
        elif both != self.result:
            raise RestartError("return")
        if self.outputs:
            self._write_outputs(value)
            self.emit("return;")
        else:
            self.emit(f"return {self.bare(value.code)};" if at_run_time(t) else "return;")
        return True

    def _joined_result(self, a: Type, b: Type) -> Type | None:
        if isinstance(a, RecordType) and isinstance(b, RecordType) and a.kind is b.kind is None:
            types = [joined(x, y) for x, y in zip(a.types, b.types, strict=False)]
            if len(a.types) != len(b.types) or None in types:
                return None
            return RecordType(None, tuple(types))  # type: ignore[arg-type]
        return joined(a, b)

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
