"""The types of the translated subset of Python, and values of them: C expressions without side effects."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import TrunkError

# A tuple of numbers with more elements than this, among an example's constants, is a static table.
LONGEST_TUPLE = 4


class UntranslatableError(TrunkError):
    """A construct outside the subset: its function, line and expression, and what to write instead."""

    def __init__(self, function: str, line: int, text: str, problem: str, remedy: str) -> None:
        self.function, self.line, self.text = function, line, text
        self.problem, self.remedy = problem, remedy
        super().__init__(f"{function}, line {line}: {text}: {problem}: {remedy}")


@dataclass(frozen=True)
class Scalar:
    """A number, a bool, or None."""

    name: str
    c: str  # empty: no value at run time


REAL, BOOLEAN, NOTHING = Scalar("float", "double"), Scalar("bool", "bool"), Scalar("None", "")
INTEGER = Scalar("int", "int64_t")
NUMBERS = (REAL, INTEGER)


@dataclass(frozen=True)
class RecordType:
    """A named tuple, or a plain one: ``kind`` is its class, None for a plain tuple."""

    kind: type[Any] | None
    types: tuple[Type, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The fields' names in Python; of a plain tuple none that Python knows."""
        if self.kind is None:
            return tuple(f"item{i}" for i in range(len(self.types)))
        names: tuple[str, ...] = self.kind._fields
        return names

    @property
    def row(self) -> bool:
        """True for a plain tuple of numbers of one type, an array in C."""
        return self.kind is None and bool(self.types) and _alike(self.types)


@dataclass(frozen=True)
class TableType:
    """Constant numbers: a tuple of known length that does not change."""

    element: Scalar
    length: int


@dataclass(frozen=True)
class Array:
    """A NumPy array of one or two dimensions, in C order: its lengths are known at run time."""

    element: Scalar
    dimensions: int


@dataclass(frozen=True, eq=False)
class Static:
    """What is known while translating and has no value in C: a function, a class, a module."""

    value: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Static) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


Type = Scalar | RecordType | TableType | Array | Static


@dataclass(frozen=True)
class Value:
    """An expression: its type, its C code, and its value where the translator knows it.

    ``parts``: the fields of a record that is not in memory yet.
    """

    type: Type
    code: str = ""
    known: int | None = None  # an int or a bool
    parts: tuple[Value, ...] | None = None


def _alike(types: Iterable[Type]) -> bool:
    kinds = set(types)
    return len(kinds) == 1 and kinds <= set(NUMBERS)


def at_run_time(t: Type) -> bool:
    """Return True if values of a type take part at run time."""
    if isinstance(t, RecordType):
        return any(map(at_run_time, t.types))
    return not isinstance(t, Static) and t != NOTHING


def type_of(value: Any, tables: bool = True, changing: tuple[type[Any], ...] = ()) -> Type:
    """Return the type of an example.

    ``tables``: long tuples of numbers in it, and fields declared as sequences, are constant tables; not so in
    records of the classes that are ``changing``, such as a law's memory.
    """
    if value is None:
        return NOTHING
    if isinstance(value, bool | np.bool_):
        return BOOLEAN
    if isinstance(value, int | np.integer):
        return INTEGER
    if isinstance(value, float | np.floating):
        return REAL
    if isinstance(value, np.ndarray) and value.dtype in (np.float64, np.int64):
        return Array(REAL if value.dtype == np.float64 else INTEGER, value.ndim)
    if not isinstance(value, tuple):
        return Static(value)
    kind = type(value) if hasattr(value, "_fields") else None
    tables = tables and kind not in changing
    declared: dict[str, Any] = getattr(kind, "__annotations__", {})
    notes = [str(declared.get(name, "")) for name in getattr(value, "_fields", [""] * len(value))]
    types = []
    for item, note in zip(value, notes, strict=True):
        if tables and isinstance(item, tuple) and not hasattr(item, "_fields"):
            types.append(table_of(item, note) or type_of(item, tables, changing))
        else:
            types.append(type_of(item, tables, changing))
    return RecordType(kind, tuple(types))


def table_of(value: Any, declared: str = "") -> TableType | None:
    """Return the type of a tuple as a constant table; None for one that is short, or no tuple of numbers."""
    if not isinstance(value, tuple) or hasattr(value, "_fields"):
        return None
    types = [type_of(item) for item in value]
    if not types:
        sequence = "Sequence" in declared or "tuple[" in declared
        return TableType(INTEGER if "int" in declared else REAL, 0) if sequence else None
    if not _alike(types) or not (len(types) > LONGEST_TUPLE or "Sequence" in declared):
        return None
    return TableType(types[0], len(types))  # type: ignore[arg-type]


def shown(t: Type) -> str:
    """Return a type as a reader of Python knows it."""
    if isinstance(t, Scalar):
        return t.name
    if isinstance(t, RecordType):
        if t.kind is not None:
            return t.kind.__name__
        return f"tuple of {', '.join(map(shown, t.types))}" if t.types else "empty tuple"
    if isinstance(t, TableType):
        return f"tuple of {t.length} {t.element.name}"
    if isinstance(t, Array):
        return f"array of {t.element.name}"
    return getattr(t.value, "__name__", None) or type(t.value).__name__
