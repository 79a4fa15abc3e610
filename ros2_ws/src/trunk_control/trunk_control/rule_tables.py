"""Rule tables of any size: labels, centres, parsing, and the set printed in the paper.

A table is a string for each label of e, with a cell for each label of e_dot, as in the paper. A cell is the
label of a consequent or a number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from trunk_core.text import plain_number

INPUT_LABELS = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")
# The usual names of so many triangles; of nine, the seven with "very big" at either end.
STANDARD_LABELS: Mapping[int, tuple[str, ...]] = {
    3: ("N", "ZO", "P"),
    5: ("NB", "NS", "ZO", "PS", "PB"),
    7: INPUT_LABELS,
    9: ("NVB", *INPUT_LABELS, "PVB"),
}
FEWEST, MOST = 2, 64  # triangles of an input
GAIN_LABELS, GAIN_CENTERS = ("S", "B"), (0.0, 1.0)
ALPHA_LABELS, ALPHA_CENTERS = ("S", "MS", "M", "B"), (2.0, 3.0, 4.0, 5.0)

# Tables 2 to 4, exactly as printed.
KP_AS_PRINTED = (
    "B B B B B B B",
    "S S B B B S S",
    "S S B B B S S",
    "S S S B S S S",
    "S S B B B S S",
    "S S B B B S S",
    "B B B B B B B",
)
KD_AS_PRINTED = (
    "S S S S S S S",
    "B B S S S B S",
    "B B B S B B B",
    "B B B B B B B",
    "B B B S B B B",
    "B B S S S B B",
    "S S S S S S S",
)
ALPHA_AS_PRINTED = (
    "S S S S S S S",
    "MS MS S S S MS MS",
    "M MS MS S MS MS M",
    "B M MS MS MS M B",
    "M MS MS S MS MS M",
    "MS MS S S S MS MS",
    "S S S S S S S",
)

# The antidiagonal table of a PD-like or PI-like controller: sum of both labels' places, limited. P. J.
# MacVicar-Whelan, Fuzzy sets for man-machine interaction, Int. J. Man-Machine Studies 8, 1976.
MACVICAR_WHELAN = tuple(
    " ".join(INPUT_LABELS[min(max(i + j - 3, 0), 6)] for j in range(7)) for i in range(7)
)

_LABEL = re.compile(r"[^\W\d][\w+-]{0,31}")
_OF_YAML = {"yes", "no", "on", "off", "true", "false", "null"}  # texts only where they are quoted


class Range(NamedTuple):
    """The numbers that a table's cells may be."""

    minimum: float
    maximum: float
    text: str

    def holds(self, number: float) -> bool:
        """Return True for a number in the range; False for NaN."""
        return self.minimum <= number <= self.maximum


UNIT = Range(0.0, 1.0, "from 0 to 1")
FRACTION = Range(-1.0, 1.0, "from -1 to 1")
POSITIVE = Range(5e-324, 1e6, "above 0")


class Axes(NamedTuple):
    """The labels of a rule base's inputs: of e, one for each row, and of e_dot, one for each column."""

    error: tuple[str, ...] = INPUT_LABELS
    rate: tuple[str, ...] = INPUT_LABELS

    def cell_name(self, row: int, column: int) -> str:
        """Return a cell's readable name, ``(e NM, e_dot PB)``."""
        return f"(e {self.error[row]}, e_dot {self.rate[column]})"


class RuleTable(NamedTuple):
    """What the cells of one table may be, and the table as written."""

    name: str  # of the output: kp
    rows: tuple[str, ...]
    centers: Mapping[str, float]  # by label
    numbers: Range

    @property
    def symbol(self) -> str:
        """The output as a text names it: ``Kp'``."""
        return {"kp": "Kp'", "kd": "Kd'"}.get(self.name, self.name)

    @property
    def title(self) -> str:
        """The output as a picture names it: ``Kp′``."""
        return self.symbol.replace("'", "′").replace("alpha", "α")

    @property
    def cells(self) -> tuple[tuple[str, ...], ...]:
        """The labels and numbers as written."""
        return tuple(tuple(row.split()) for row in self.rows)

    def values(self, axes: Axes) -> tuple[float, ...]:
        """Return the table's centres, row by row (`centers`)."""
        return centers(self.rows, self.centers, axes, self.numbers)


@lru_cache(maxsize=256)  # a sweep makes thousands of configurations
def input_labels(given: tuple[str, ...], count: int, letter: str) -> tuple[str, ...]:
    """Return the labels of an input with so many triangles: as given, else the standard ones, else numbers.

    ``letter``: of labels that are numbered, E1, E2 and so on. Raises ValueError for another number of labels,
    and what `check_labels` raises.
    """
    if not given:
        usual = STANDARD_LABELS.get(count)
        return usual or tuple(f"{letter}{i}" for i in range(1, count + 1))
    if len(given) != count:
        raise ValueError(f"one label for each of the {count} peaks; there are {len(given)}")
    check_labels(given)
    return given


def check_labels(labels: Sequence[str]) -> None:
    """Raise ValueError for a text that cannot be a label, and for one that is there twice."""
    for i, label in enumerate(labels):
        if not _LABEL.fullmatch(label) or label.lower() in _OF_YAML or _number(label) is not None:
            raise ValueError(
                f"each label one word of up to 32 letters, digits, _, + or -, a letter first, and neither a "
                f"number nor yes, no, on, off; one is {label[:40]!r}"
            )
        if label in labels[:i]:
            raise ValueError(f"each label once; {label} is there twice")


def centers(
    rows: Sequence[str], values: Mapping[str, float], axes: Axes, numbers: Range
) -> tuple[float, ...]:
    """Return a table's centres, row by row, from its rows of cells and the labels' values.

    Raises ValueError naming the row or cell whose shape, label or number is wrong.
    """
    return _centers(tuple(rows), tuple(values.items()), axes, numbers)


@lru_cache(maxsize=64)  # the runs of a sweep share their tables
def _centers(
    rows: tuple[str, ...], items: tuple[tuple[str, float], ...], axes: Axes, numbers: Range
) -> tuple[float, ...]:
    values = dict(items)
    if len(rows) != len(axes.error):
        raise ValueError(f"{len(axes.error)} rows, one per label of e; there are {len(rows)}")
    table: list[float] = []
    for i, row in enumerate(rows):
        cells = row.split()
        if len(cells) != len(axes.rate):
            raise ValueError(
                f"{len(axes.rate)} labels in each row; row {i + 1} (e {axes.error[i]}) has {len(cells)}"
            )
        for j, cell in enumerate(cells):
            number = values.get(cell, _number(cell))
            if number is None or not (cell in values or numbers.holds(number)):
                raise ValueError(
                    f"labels {', '.join(values)}, or numbers {numbers.text}; "
                    f"cell {axes.cell_name(i, j)} is {cell[:20]!r}"
                )
            table.append(number)
    return tuple(table)


def is_table(value: object) -> bool:
    """Return True for rows of cells, at least two of each, as many in each row."""
    return (
        isinstance(value, tuple | list)
        and len(value) >= FEWEST
        and all(isinstance(row, str) and len(row.split()) >= FEWEST for row in value)
        and len({len(row.split()) for row in value}) == 1
    )


def axes_of(rows: Sequence[str], parameters: Mapping[str, Any]) -> Axes:
    """Return the labels of a table, for display: its node's where they fit, else the usual ones."""

    def labels(axis: str, count: int, letter: str) -> tuple[str, ...]:
        given = parameters.get(f"fuzzy.{axis}_labels")
        if isinstance(given, tuple | list) and len(given) == count:
            return tuple(map(str, given))
        return input_labels((), count, letter)

    return Axes(labels("error", len(rows), "E"), labels("rate", len(rows[0].split()), "R"))


class CellChange(NamedTuple):
    """A cell of two tables of one shape that is not the same in both."""

    row: int
    column: int
    before: str
    after: str


def cell_changes(before: Sequence[str], after: Sequence[str]) -> tuple[CellChange, ...]:
    """Return the cells in which two tables differ. Raises ValueError for tables of different shapes."""
    return tuple(
        CellChange(i, j, old, new)
        for i, rows in enumerate(zip(before, after, strict=True))
        for j, (old, new) in enumerate(zip(*(row.split() for row in rows), strict=True))
        if old != new
    )


def _number(cell: str) -> float | None:
    try:
        return plain_number(cell)
    except ValueError:
        return None
