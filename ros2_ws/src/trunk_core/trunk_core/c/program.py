"""One C text: its names, its types of records, its constants, and the functions that share them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.resources import files
from math import copysign, isinf, isnan
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from .types import (
    BOOLEAN,
    INTEGER,
    NOTHING,
    REAL,
    Array,
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

# Of C, of C++, of our own text.
RESERVED = set(
    re.findall(
        r"\w+",
        """
        auto break case char const continue default do double else enum extern float for goto if inline int
        long register restrict return short signed sizeof static struct switch typedef union unsigned void
        volatile while bool true false asm typeof main alignas alignof and_eq bitand bitor catch class
        char8_t char16_t char32_t compl concept constexpr const_cast decltype delete dynamic_cast explicit
        export friend mutable namespace new noexcept nullptr operator or_eq private protected public
        reinterpret_cast requires static_assert static_cast template this thread_local throw try typeid
        and or not not_eq co_await co_return co_yield consteval constinit
        typename using virtual wchar_t xor xor_eq unix linux near far result NULL EOF INT64_C
        Reals RealRows Integers IntegerRows memory_of NOT_A_NUMBER INFINITE
        """,
    )
)
_EXACT_DIGITS = 7


def template(name: str, package: str = __package__) -> str:
    """Return a text from a package's folder ``templates``."""
    return (Path(str(files(package))) / "templates" / f"{name}.in").read_text("utf-8").strip()


INCLUDES = """#include <float.h>
#include <stdbool.h>
#include <stdint.h>"""
# Refused where it can be seen while compiling; NAME_self_test() finds what cannot.
ARITHMETIC = template("arithmetic.h")
# What stands for operators and built-in functions of Python.
HELPERS = {
    re.split(r"\W+", text.partition("(")[0])[-1]: text
    for text in template("helpers.h").split("\n\n")
}


@dataclass
class Translated:
    """A function in C."""

    python: FunctionType
    name: str
    result: Type
    writes: bool  # it writes into an array that it is given
    text: str


class Definitions:
    """What is defined in one C text so far. ``prefix``: of the names of records."""

    def __init__(self, prefix: str = "") -> None:
        self.prefix = prefix
        self.names: set[str] = set(HELPERS) | RESERVED  # of the whole program
        self.local_names: set[str] = set()
        self.functions: dict[tuple[Any, ...], Translated] = {}  # in the order of their definitions
        self.busy: list[tuple[Any, ...]] = []  # functions that are being translated
        self.titles: dict[RecordType, str] = {}  # names of plain tuples
        self.records: dict[RecordType, str] = {}  # in the order of their definitions
        self._constants: dict[tuple[str, Any], tuple[str, str]] = {}  # name, definition

    # Names ---------------------------------------------------------------------------------------------

    def name(self, wanted: str) -> str:
        """Return a name of the whole program like the one wanted, and never return it again."""
        wanted = re.sub(r"\W", "_", wanted).strip("_")
        name, count = wanted, 1
        while name in self.names or name in self.local_names:
            count += 1
            name = f"{wanted}_{count}"
        self.names.add(name)
        return name

    def local(self, name: str) -> str:
        """Return the C name of a local variable of Python."""
        plain = re.sub(r"\W", "_", name if name.isascii() else f"v_{name.encode().hex()}")
        while plain in self.names or re.match(r"_[A-Z_]", plain):
            plain = f"{plain.lstrip('_') or 'unnamed'}_"
        self.local_names.add(plain)
        return plain

    @staticmethod
    def field(record: RecordType, i: int) -> str:
        """Return the C name of a record's field, as it follows the dot."""
        if record.row:
            return f"v[{i}]"
        name = record.names[i]
        return f"{name}_" if name in RESERVED else name

    # Types ---------------------------------------------------------------------------------------------

    def c_type(self, t: Type) -> str:
        """Return a type's name in C. Raises TypeError for one without values at run time."""
        if isinstance(t, Scalar) and t.c:
            return t.c
        if isinstance(t, RecordType) and at_run_time(t):
            return self._record(t)
        if isinstance(t, TableType):
            return f"const {t.element.c} *"
        if isinstance(t, Array):
            names = ("Reals", "RealRows", "Integers", "IntegerRows")
            return names[(t.dimensions - 1) + 2 * (t.element == INTEGER)]
        raise TypeError(f"{t} has no values at run time")

    def _record(self, record: RecordType) -> str:
        if record not in self.records:
            for inner in record.types:
                if at_run_time(inner):
                    self.c_type(inner)
            kind = record.kind.__name__ if record.kind is not None else "Tuple"
            kind = self.titles.get(record, kind)
            self.records[record] = self.name(f"{self.prefix}{kind.strip('_')}")
        return self.records[record]

    def declared(self, t: Type, name: str) -> str:
        """Return a name behind its type."""
        c = self.c_type(t)
        return f"{c}{name}" if c.endswith("*") else f"{c} {name}"

    def structure(self, record: RecordType) -> str:
        """Return the definition of a record's type."""
        if record.row:
            fields = [f"    {self.declared(record.types[0], f'v[{len(record.types)}]')};"]
        else:
            notes = _comments(record.kind)
            fields = [
                f"    {self.declared(t, self.field(record, i))};{notes.get(record.names[i], '')}"
                for i, t in enumerate(record.types)
                if at_run_time(t)
            ]
        return "\n".join(["typedef struct {", *fields, f"}} {self.records[record]};"])

    def places(self, t: Type, place: str) -> Iterator[tuple[str, Type]]:
        """Yield the numbers, tables and arrays in a place of this type: their names in C, and their types."""
        if isinstance(t, RecordType):
            for i, inner in enumerate(t.types):
                yield from self.places(inner, f"{place}.{self.field(t, i)}")
        elif at_run_time(t):
            yield place, t

    # Constants -----------------------------------------------------------------------------------------

    @staticmethod
    def literal(value: Any, name: str = "") -> str:
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

    def table(self, values: Sequence[Any], t: TableType, name: str = "table") -> str:
        """Return the name of a static table with these numbers; equal ones are one."""
        numbers = tuple(float(v).hex() if t.element == REAL else int(v) for v in values)
        key = (f"{t.element.c}[{len(numbers)}]", numbers)
        if key not in self._constants:
            c = self.name(name)
            items = [self.literal(v if t.element != REAL else float(v)) for v in values] or ["0"]
            size = f"[{max(len(values), 1)}]"
            text = f"static const {t.element.c} {c}{size} = {{\n{_wrapped(items)}\n}};"
            self._constants[key] = (c, text)
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
        for name, item, inner in zip(t.names, value, t.types, strict=True):
            if at_run_time(inner):
                named = t.kind is not None
                text = (
                    self.table(item, inner, name)
                    if isinstance(inner, TableType) and named
                    else self.initial(item, inner, indent + 1)
                )
                rows.append(f"{pad}{text},{f' /* {name} */' if named else ''}")
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
        if t != REAL:
            return self.known(value, name)
        number = float(value)
        if not name or isnan(number) or isinf(number) or _is_short(number):
            return Value(t, real_literal(number))
        key = (name, number.hex())
        if key not in self._constants:
            c = self.name(name)
            self._constants[key] = (c, f"static const double {c} = {definition(number)};")
        return Value(t, self._constants[key][0])

    def known(self, value: Any, name: str = "") -> Value:
        """Return an int or a bool that is known."""
        if isinstance(value, bool | np.bool_):
            return Value(BOOLEAN, self.literal(value), bool(value))
        return Value(INTEGER, self.literal(value, name), int(value))

    # The text ------------------------------------------------------------------------------------------

    def text(self, roots: str) -> str:
        """Return constants, helpers and the functions that a text calls, directly or not, in C."""
        words = set(re.findall(r"[A-Za-z_]\w*", roots))
        kept: list[str] = []
        for f in reversed(self.functions.values()):
            if f.name in words:
                kept.append(f.text)
                code = re.sub(r"/\*.*?\*/", "", f.text, flags=re.S)
                words |= set(re.findall(r"[A-Za-z_]\w*", code))
        for name, helper in reversed(HELPERS.items()):
            if name in words:
                words |= set(re.findall(r"\w+", helper))
        helpers = [text for name, text in HELPERS.items() if name in words]
        constants = [text for name, text in self._constants.values() if name in words]
        return "\n\n".join([*helpers, *(["\n".join(constants)] if constants else []), *kept[::-1]])

    def library(self, roots: str, head: str = f"{INCLUDES}\n\n{ARITHMETIC}") -> str:
        """Return one C text: a ``head``, all records, and the functions that ``roots`` mentions."""
        structures = map(self.structure, self.records)
        arrays = template("arrays.h")
        parts = [head, arrays, *structures, self.text(roots)]
        return "\n\n".join(parts) + "\n"


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
    text = repr(abs(number))
    few = "e" not in text and len(text) <= _EXACT_DIGITS + 1
    return few and Fraction(text) == Fraction(abs(number))


def _wrapped(items: Sequence[str]) -> str:
    rows: list[str] = []
    for item in items:
        if rows and len(rows[-1]) + len(item) < 96:
            rows[-1] += f" {item},"
        else:
            rows.append(f"    {item},")
    return "\n".join(rows)


def _comments(kind: type[Any] | None) -> dict[str, str]:
    """Return the comments behind a named tuple's fields: units and meanings."""
    try:
        source = inspect.getsource(kind) if kind is not None else ""
    except (OSError, TypeError):
        return {}
    matches = re.finditer(r"^\s+(\w+)\s*:[^#\n]*#\s*(.+)$", source, re.M)
    return {match[1]: f" /* {match[2].strip().replace('*/', '* /')} */" for match in matches}
