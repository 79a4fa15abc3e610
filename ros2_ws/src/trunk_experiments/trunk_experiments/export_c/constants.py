"""Constants of a program in C: numbers with their bits, static tables, initialisers of records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from math import copysign, isinf, isnan
from typing import Any

import numpy as np

from .types import (
    BOOLEAN,
    NATURAL,
    NOTHING,
    REAL,
    RecordType,
    Scalar,
    Static,
    TableType,
    Type,
    Value,
    at_run_time,
    table_of,
    type_of,
)

_EXACT_DIGITS = 7


class Constants:
    """What `program.Program` knows of constants."""

    name: Callable[[str], str]
    _constants: dict[tuple[str, Any], tuple[str, str]]  # name, definition

    # Constants -----------------------------------------------------------------------------------------

    def literal(self, value: Any, name: str = "") -> str:
        """Return a number or a bool as a C expression; a ``name`` is told in a comment."""
        if isinstance(value, bool | np.bool_):
            return "true" if value else "false"
        if isinstance(value, int | np.integer):
            number = int(value)
            text = f"{number}" if abs(number) <= 1000 else f"INT64_C({number})"
            text = f"({text})" if number < 0 else text
            if number == -(2**63):
                text = "(-INT64_C(9223372036854775807) - 1)"
            return f"{text} /* {name} */" if name else text
        return real_literal(float(value))

    def constant(self, value: float, name: str) -> str:
        """Return the name of a constant of the whole program."""
        key = (name, float(value).hex())
        if key not in self._constants:
            c = self.name(name)
            self._constants[key] = (c, f"static const double {c} = {definition(float(value))};")
        return self._constants[key][0]

    def table(self, values: Sequence[Any], t: TableType, name: str = "table") -> str:
        """Return the name of a static table with these numbers; equal ones are one."""
        numbers = tuple(float(v).hex() if t.element == REAL else int(v) for v in values)
        key = (f"{t.element.c}[{len(numbers)}]", numbers)
        if key not in self._constants:
            c = self.name(name)
            items = [self.literal(v if t.element != REAL else float(v)) for v in values] or ["0"]
            rows = _wrapped(items)
            self._constants[key] = (
                c,
                f"static const {t.element.c} {c}[{max(len(values), 1)}] = {{\n{rows}\n}};",
            )
        return self._constants[key][0]

    def initial(self, value: Any, t: Type, indent: int = 1) -> str:
        """Return an example as an initialiser of a type's variable."""
        if isinstance(t, Scalar):
            return self.literal(float(value) if t == REAL else value)
        if isinstance(t, TableType):
            return self.table(value, t)
        if not isinstance(t, RecordType):
            raise TypeError(f"{t} has no initialiser")
        pad = "    " * indent
        rows = []
        for i, (item, inner) in enumerate(zip(value, t.types, strict=True)):
            if at_run_time(inner):
                text = (
                    self.table(item, inner, t.names[i])
                    if isinstance(inner, TableType) and t.kind is not None
                    else self.initial(item, inner, indent + 1)
                )
                note = f" /* {t.names[i]} */" if t.kind is not None else ""
                rows.append(f"{pad}{text},{note}")
        inside = "\n".join(rows)
        if t.row:
            inside = f"{pad}{{\n{inside}\n{pad}}}"
        return f"{{\n{inside}\n{'    ' * (indent - 1)}}}"

    def value(self, value: Any, name: str = "") -> Value:
        """Return a constant of Python as a value; ``name``: how it is called in the source."""
        t = table_of(value) or type_of(value)
        if isinstance(t, Static) or t == NOTHING:
            return Value(t)
        if isinstance(t, TableType):
            return Value(t, self.table(value, t, name or "table"))
        if isinstance(t, RecordType):
            return Value(t, parts=tuple(self.value(item) for item in value))
        if t == REAL:
            number = float(value)
            plain = not name or isnan(number) or isinf(number) or _is_short(number)
            return Value(t, real_literal(number) if plain else self.constant(number, name))
        return self.known(value, name)

    def known(self, value: Any, name: str = "") -> Value:
        """Return an int or a bool that is known."""
        if isinstance(value, bool | np.bool_):
            return Value(BOOLEAN, self.literal(bool(value)), known=bool(value))
        t = type_of(value)

        return Value(NATURAL if value >= 0 else t, self.literal(int(value), name), known=int(value))


def real_literal(number: float) -> str:
    """Return a double as a C expression that has its bits; what is not short in decimals in hexadecimal."""
    if isnan(number):
        return "NOT_A_NUMBER"
    if isinf(number):
        return "INFINITE" if number > 0.0 else "(-INFINITE)"
    negative = copysign(1.0, number) < 0.0
    size = abs(number)
    text = repr(size) if _is_short(size) else f"{size.hex()} /* {size!r} */"
    return f"(-{text})" if negative else text


def definition(number: float) -> str:
    """Return a double as `real_literal` does, as all there is to the right of a sign of equality."""
    literal = real_literal(number)
    if not literal.startswith("(-"):
        return literal
    return literal[1:-1].replace("/* ", "/* -")


def _is_short(number: float) -> bool:
    """Return True if a few decimals are exactly the double."""
    if isinf(number):
        return False
    text = repr(abs(number))
    return (
        "e" not in text
        and len(text) <= _EXACT_DIGITS + 1
        and Fraction(text) == Fraction(abs(number))
    )


def _wrapped(items: Sequence[str]) -> str:
    rows: list[str] = []
    for item in items:
        if rows and len(rows[-1]) + len(item) < 96:
            rows[-1] += f" {item},"
        else:
            rows.append(f"    {item},")
    return "\n".join(rows)
