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
    return [value for one in record for value in row_values(one)]


def in_common(record: Any) -> Any:
    """Return a record without the numbers that have rows: equal for runs that can share a block."""
    if type(record) is float:
        return float
    if not _has_rows(record):
        return record
    return type(record).__name__, *(in_common(one) for one in record)


def shared(record: Any) -> Any:
    """Return a record as compiled code takes it: its tables as arrays, its False flags as None (`pruned`)."""
    if _has_rows(record):
        parts = [shared(one) for one in record]
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
    readers = []
    for one in record:
        reader, row = reader_of(one, row)
        readers.append(reader)
    read_all = _one_after_another(readers, 0)
    if not hasattr(record, "_fields"):
        return read_all, row
    kind = type(record)

    def read_record(cells: Floats, lane: int, common: Any) -> Any:
        return kind(*read_all(cells, lane, common))

    return read_record, row


def _has_rows(record: Any) -> bool:
    return hasattr(record, "_fields") or (
        type(record) is tuple and not all(type(one) is float for one in record)
    )


def _as_it_is(cells: Floats, lane: int, common: Any) -> Any:
    return common


def _one_after_another(readers: Sequence[Reader], index: int) -> Reader:
    """Return a function that makes a tuple by these readers, of ``common`` from ``index`` on."""
    first = readers[0]
    if len(readers) == 1:

        def read_last(cells: Floats, lane: int, common: Any) -> Any:
            return (first(cells, lane, common[index]),)

        return read_last
    rest = _one_after_another(readers[1:], index + 1)

    def read_first(cells: Floats, lane: int, common: Any) -> Any:
        return (first(cells, lane, common[index]), *rest(cells, lane, common))

    return read_first
