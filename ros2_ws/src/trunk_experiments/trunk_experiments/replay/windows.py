"""A long record, window by window: what compiled stretches read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from . import stretches

Record = TypeVar("Record")


class Windows(Generic[Record]):
    """The last window that was asked for: a replay goes forwards, and a whole record is too large."""

    def __init__(self, record: Callable[[slice], Record]) -> None:
        """``record`` returns the record of some rows, from the first one on."""
        self._record = record
        self._begin: int | None = None
        self._window: Record

    def around(self, row: int) -> tuple[int, Record]:
        """Return the first row of the window around a row, and its record."""
        begin = row - row % stretches.LONGEST
        if begin != self._begin:
            window = slice(begin, begin + stretches.LONGEST)
            self._begin, self._window = begin, self._record(window)
        return begin, self._window
