"""What translated functions share: their names in C, types of records, constants, tables, helpers."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any

from .constants import Constants
from .helpers import HELPERS, needed
from .types import (
    INTEGER,
    NOTHING,
    Array,
    RecordType,
    Scalar,
    TableType,
    Type,
    at_run_time,
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


@dataclass
class Translated:
    """A function in C."""

    python: FunctionType
    name: str
    arguments: list[tuple[str, Type]]  # the C names of those that take part at run time
    result: Type = NOTHING
    outputs: list[tuple[str, Type]] = field(default_factory=list)  # written through pointers
    writes: bool = False  # it writes into an array that it is given
    in_place: bool = False  # its first output may be its first argument
    text: str = ""


class RestartError(Exception):
    """A variable or a result turned out to have a wider type."""


class Definitions(Constants):
    """What is defined in one C text so far."""

    def __init__(self, prefix: str = "") -> None:
        self.prefix = prefix
        self.names: set[str] = set(HELPERS) | RESERVED  # of the whole program
        self.local_names: set[str] = set()
        self.functions: dict[tuple[Any, ...], Translated] = {}
        self.ordered: list[Translated] = []
        self.busy: list[tuple[Any, ...]] = []
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
            return self._array(t)
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

    @staticmethod
    def _array(t: Array) -> str:
        return ("Reals", "RealRows", "Integers", "IntegerRows")[
            (t.dimensions - 1) + 2 * (t.element == INTEGER)
        ]

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

    # Functions -----------------------------------------------------------------------------------------

    def function(self, python: Callable[..., Any], types: Sequence[Type]) -> Translated:
        """Return a function translated for arguments of these types; `translate.Program` does it."""
        raise NotImplementedError

    def text(self, roots: str) -> str:
        """Return constants, helpers and the functions that a text calls, directly or not, in C."""
        words = set(re.findall(r"[A-Za-z_]\w*", roots))
        kept: list[str] = []
        for f in reversed(self.ordered):
            if f.name in words:
                kept.append(f.text)
                words |= set(re.findall(r"[A-Za-z_]\w*", _without_comments(f.text)))
        constants = [text for name, text in self._constants.values() if name in words]
        return "\n\n".join(
            [*needed(words), *(["\n".join(constants)] if constants else []), *reversed(kept)]
        )


def qualified(python: Any) -> str:
    """Return a function's module and name."""
    return f"{getattr(python, '__module__', '?')}.{getattr(python, '__qualname__', python)}"


def _without_comments(text: str) -> str:
    return re.sub(r"/\*.*?\*/", "", text, flags=re.S)


def _comments(kind: type[Any] | None) -> dict[str, str]:
    """Return the comments behind a named tuple's fields: units and meanings."""
    if kind is None:
        return {}
    try:
        source = inspect.getsource(kind)
    except (OSError, TypeError):
        return {}
    notes = {}
    for match in re.finditer(r"^\s+(\w+)\s*:[^#\n]*#\s*(.+)$", source, re.M):
        notes[match[1]] = f" /* {match[2].strip().replace('*/', '* /')} */"
    return notes


def first_line(python: FunctionType) -> str:
    """Return the first line of a docstring, empty if there is none."""
    lines = (inspect.getdoc(python) or "").splitlines()
    return lines[0].replace("*/", "* /").replace("``", "").replace("`", "") if lines else ""
