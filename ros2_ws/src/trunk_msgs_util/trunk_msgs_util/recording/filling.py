"""A regular JointState topic read block by block into arrays of full length, while others are read too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .joint_arrays import QUANTITIES, Floats, Integers, JointArrays, stamps, structured

if TYPE_CHECKING:
    from .messages import Messages


class Filling:
    """Takes a topic's messages in their order. ``regular``: all have the same names and quantities."""

    def __init__(self, count: int, values: bool) -> None:
        """Expect ``count`` messages; without ``values``, only their stamps and what is in each are kept."""
        self.regular = True
        self.names: tuple[str, ...] = ()
        self.widths: dict[str, int] = {}
        self._values: dict[str, Floats] | None = {} if values else None
        self._count, self._found = count, 0
        self._stamp_ns: Integers = np.empty(count, np.int64)
        self._log_time_ns: Integers = np.empty(count, np.int64)

    def take(self, messages: Messages) -> None:
        """Take the next messages."""
        rows = slice(self._found, self._found + len(messages))
        found = structured(messages) if self.regular and rows.stop <= self._count else None
        if found is None:
            self.regular = False
            return
        names, array = found
        widths = {quantity: array[quantity].shape[1] for quantity in QUANTITIES}
        if not self._found:
            self._begin(names, widths)
        if (names, widths) != (self.names, self.widths):
            self.regular = False
            return
        self._found = rows.stop
        self._stamp_ns[rows] = stamps(array)
        self._log_time_ns[rows] = messages.log_time_ns
        for quantity, values in (self._values or {}).items():
            values[rows] = array[quantity]

    def _begin(self, names: tuple[str, ...], widths: dict[str, int]) -> None:
        self.names, self.widths = names, widths
        self.regular = all(width in (0, len(names)) for width in widths.values())
        if self._values is not None:
            self._values = {q: np.empty((self._count, width)) for q, width in widths.items()}

    @property
    def whole(self) -> bool:
        """True if the topic is regular, and as many messages came as were expected."""
        return self.regular and 0 < self._found == self._count

    def times(self, known: Integers | None) -> tuple[Integers, Integers]:
        """Return stamps and log times [N], in ns; equal ones, also to those ``known``, share their memory."""
        stamp_ns, log_ns = self._stamp_ns, self._log_time_ns
        if known is not None and np.array_equal(stamp_ns, known):
            stamp_ns = known
        return stamp_ns, stamp_ns if np.array_equal(stamp_ns, log_ns) else log_ns

    def arrays(self, stamp_ns: Integers, log_ns: Integers) -> JointArrays | None:
        """Return the messages, with the times of `times`; None if their values were not kept."""
        if self._values is None:
            return None
        return JointArrays(self.names, stamp_ns, log_ns, *(self._values[q] for q in QUANTITIES))
