"""Named tuples of many runs side by side: one row of cells per number, one column (lane) per run.

The cells are one flat array whose rows all have `LANES` numbers, so that a compiler sees that rows do not
overlap, and handles several lanes with one instruction.

What is not a float (modes, flags), and tuples of floats (rule tables), are the same in all lanes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Floats

LANES = 16

Reader = Callable[[Floats, int, Any], Any]


def row_values(record: Any) -> list[float]:
    """Return the numbers of a record that have rows, in order."""
    if type(record) is float:
        return [record]
    if not _has_rows(record):
        return []
    return [value for part in record for value in row_values(part)]


def in_common(record: Any) -> Any:
    """Return a record without the numbers that have rows: equal for runs that can share a block."""
    if type(record) is float:
        return float
    if not _has_rows(record):
        return record
    return type(record).__name__, *(in_common(part) for part in record)


def shared(record: Any) -> Any:
    """Return a record as compiled code takes it: its tables as arrays, its False flags as None (`pruned`)."""
    if _has_rows(record):
        parts = [shared(part) for part in record]
        return record._make(parts) if hasattr(record, "_fields") else tuple(parts)
    if record is False:
        return None
    return np.array(record, dtype=np.float64) if type(record) is tuple else record


def reader_of(record: Any, row: int) -> tuple[Reader, int]:
    """Return a function that makes such a record from the cells, and the row after its last.

    ``read(cells, lane, common)`` takes what has no row from ``common``, a record of the same structure.
    """
    if type(record) is float:

        def read_cell(cells: Floats, lane: int, common: Any) -> Any:
            return cells[row * LANES + lane]

        return read_cell, row + 1
    if not _has_rows(record):
        return _as_it_is, row
    readers: list[Reader] = []  # of tuples, which together are the record's parts
    index = 0
    while index < len(record):
        parts = record[index:]
        if count := _leading(parts, lambda part: type(part) is float):
            count, reader = _block_of(count, row)
            row += count
        elif count := _leading(parts, lambda part: type(part) is not float and not _has_rows(part)):
            reader = _taken(index, index + count)
        else:
            count = 1
            read_part, row = reader_of(parts[0], row)
            reader = _alone(read_part, index)
        readers.append(reader)
        index += count
    read_all = _one_after_another(readers)
    if not hasattr(record, "_fields"):
        return read_all, row
    kind = type(record)

    def read_record(cells: Floats, lane: int, common: Any) -> Any:
        return kind(*read_all(cells, lane, common))

    return read_record, row


def _has_rows(record: Any) -> bool:
    return hasattr(record, "_fields") or (
        type(record) is tuple and not all(type(part) is float for part in record)
    )


def _as_it_is(cells: Floats, lane: int, common: Any) -> Any:
    return common


def _taken(begin: int, end: int) -> Reader:
    """Return a function that takes some parts of ``common`` as they are."""

    def take(cells: Floats, lane: int, common: Any) -> Any:
        return common[begin:end]

    return take


def _leading(parts: Sequence[Any], fits: Callable[[Any], bool]) -> int:
    """Return how many of the first parts fit."""
    return next((i for i, part in enumerate(parts) if not fits(part)), len(parts))


def _block_of(count: int, row: int) -> tuple[int, Reader]:
    """Return how many cells, at most ``count``, a function reads at once as a tuple, and that function.

    numba takes some 0.05 s for each function, however short: four cells are one function, not eight.
    """
    if count >= 4:

        def read_four(cells: Floats, lane: int, common: Any) -> Any:
            at = row * LANES + lane
            return cells[at], cells[at + LANES], cells[at + 2 * LANES], cells[at + 3 * LANES]

        return 4, read_four
    if count >= 2:

        def read_two(cells: Floats, lane: int, common: Any) -> Any:
            at = row * LANES + lane
            return cells[at], cells[at + LANES]

        return 2, read_two

    def read_one(cells: Floats, lane: int, common: Any) -> Any:
        return (cells[row * LANES + lane],)

    return 1, read_one


def _alone(reader: Reader, index: int) -> Reader:
    """Return a function that reads one part of a record, as a tuple of one."""

    def read_part(cells: Floats, lane: int, common: Any) -> Any:
        return (reader(cells, lane, common[index]),)

    return read_part


def _one_after_another(readers: Sequence[Reader]) -> Reader:
    """Return a function that makes one tuple of those that the readers make."""
    if len(readers) == 1:
        return readers[0]
    half = len(readers) // 2
    left, right = _one_after_another(readers[:half]), _one_after_another(readers[half:])

    def read_both(cells: Floats, lane: int, common: Any) -> Any:
        return (*left(cells, lane, common), *right(cells, lane, common))

    return read_both
