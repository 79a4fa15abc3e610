"""The last rows of numbers of a stream, for readers at their own pace. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trunk_msgs_util.recording.joint_table import Floats


class StreamRows:
    """The last ``kept`` rows of a stream; a reader knows a row by its number since the beginning."""

    def __init__(self, names: Sequence[str], kept: int) -> None:
        self.names = tuple(names)
        self.count = 0  # of all rows ever added
        self._kept = kept
        # Twice as many as are kept, so that those are always in one piece.
        self._values: Floats = np.empty((2 * kept, len(self.names)))
        self._end = 0

    @classmethod
    def of(cls, names: Sequence[str], values: Floats) -> StreamRows:
        """Return rows that are all present from the beginning and never dropped."""
        rows = cls(names, 0)
        rows._values = np.ascontiguousarray(values, np.float64)
        rows.count = rows._end = rows._kept = len(values)
        return rows

    @property
    def oldest(self) -> int:
        """The number of the oldest row that is still there."""
        return self.count - min(self._end, self._kept)

    def add(self, row: Sequence[float]) -> None:
        """Add a row, one number for each name; the oldest is dropped."""
        if self._end == len(self._values):
            self._values[: self._kept] = self._values[self._end - self._kept :]
            self._end = self._kept
        self._values[self._end] = row
        self._end += 1
        self.count += 1

    def last(self) -> dict[str, float]:
        """Return the newest row by name; empty where there is none."""
        if not self.count:
            return {}
        return dict(zip(self.names, self._values[self._end - 1].tolist(), strict=True))

    def since(self, number: int, most: int) -> tuple[int, Floats]:
        """Return the first row's number and up to ``most`` rows, from this number or the oldest on."""
        first = max(number, self.oldest)
        begin = self._end - (self.count - first)
        return first, self._values[begin : min(begin + most, self._end)]
