"""Rule tables: labels, centres, parsing, and the set printed in the paper.

A table is written as seven strings of seven labels, one row per label of e (NB ... PB) and one column
per label of e_dot, as in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

INPUT_LABELS = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")
GAIN_CENTERS: Mapping[str, float] = {"S": 0.0, "B": 1.0}
ALPHA_LABELS = ("S", "MS", "M", "B")

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


def cell_name(row: int, column: int) -> str:
    """Return a cell's readable name, ``(e NM, e_dot PB)``."""
    return f"(e {INPUT_LABELS[row]}, e_dot {INPUT_LABELS[column]})"


def centers(rows: Sequence[str], values: Mapping[str, float]) -> tuple[float, ...]:
    """Return a table's centres, row by row, from its strings of labels and the labels' values.

    Raises ValueError naming the row or cell whose shape or label is wrong.
    """
    return _centers(tuple(rows), tuple(values.items()))


@lru_cache(maxsize=64)  # the runs of a sweep share their tables
def _centers(rows: tuple[str, ...], items: tuple[tuple[str, float], ...]) -> tuple[float, ...]:
    values = dict(items)
    size = len(INPUT_LABELS)
    if len(rows) != size:
        raise ValueError(f"{size} rows, one per label of e; there are {len(rows)}")
    table: list[float] = []
    for i, row in enumerate(rows):
        labels = row.split()
        if len(labels) != size:
            raise ValueError(
                f"{size} labels in each row; row {i + 1} (e {INPUT_LABELS[i]}) has {len(labels)}"
            )
        for j, label in enumerate(labels):
            if label not in values:
                raise ValueError(
                    f"labels {', '.join(values)}; cell {cell_name(i, j)} is {label[:20]!r}"
                )
            table.append(values[label])
    return tuple(table)
