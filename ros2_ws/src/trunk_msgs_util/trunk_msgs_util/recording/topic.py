"""`Topic`: what is recorded on one topic, counted as its messages are scanned."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from .. import topics as names
from ..errors import TrunkError
from ..units import NANOSECONDS
from .faults import Faults, JointCheck
from .limits import LimitError

if TYPE_CHECKING:
    from .joint_arrays import Integers
    from .messages import Messages

# These types begin with a stamp, right after the encapsulation header.
STAMPED = (
    names.JOINT_STATE_TYPE,
    names.PARAMETER_EVENT_TYPE,
    names.DIAGNOSTIC_ARRAY_TYPE,
    names.CLOCK_TYPE,
)


class RecordingError(TrunkError):
    """The file cannot be used as a recording: one line that names it and says what to do."""


@dataclass
class Topic:
    """What is recorded on a topic; stamps are the headers', or else the log times."""

    type: str
    count: int = 0
    first_stamp_ns: int | None = None
    last_stamp_ns: int | None = None
    size: int = 0  # encoded bytes
    last_log_ns: int | None = None
    longest_gap_ns: int = 0  # between the log times of consecutive messages
    faults: Faults = field(default_factory=Faults)
    _check: JointCheck = field(default_factory=JointCheck, repr=False, compare=False)

    @property
    def readable(self) -> int:
        """How many of the messages can be read, as far as they were looked at."""
        return 0 if self.faults.limit is not None else self.count - self.faults.count

    def take(self, messages: Messages) -> list[int]:
        """Count some messages that follow the earlier ones; return the rows that cannot be read."""
        bad = self._bad(messages)
        for row, why in bad:
            self.faults.add(self.count + row, int(messages.log_time_ns[row]), why)
        rows = [row for row, _ in bad]
        good = messages.without(rows) if rows else messages
        self.count += len(messages)
        self.size += int((messages.end - messages.start).sum())
        if len(good):
            self.take_stamps(good, good)
        self.take_log(messages.log_time_ns)
        return rows

    def _bad(self, messages: Messages) -> list[tuple[int, str]]:
        if self.type != names.JOINT_STATE_TYPE or self.faults.limit is not None:
            return []
        try:
            return self._check.bad(messages)
        except LimitError as error:
            self.faults.limit = str(error)
            return []

    def take_stamps(self, first: Messages, last: Messages) -> None:
        """Take account of the first stamp of some messages, and of the last stamp of others."""
        begin, end = (
            stamp_at(messages.data, int(messages.start[i]))
            if self.type in STAMPED
            else int(messages.log_time_ns[i])
            for messages, i in ((first, 0), (last, -1))
        )
        if self.first_stamp_ns is None:
            self.first_stamp_ns = begin
        self.last_stamp_ns = end

    def take_log(self, log_time_ns: Integers) -> None:
        """Take account of the log times of one or more messages that follow the earlier ones."""
        first, last = int(log_time_ns[0]), int(log_time_ns[-1])
        if self.last_log_ns is not None:
            self.longest_gap_ns = max(self.longest_gap_ns, first - self.last_log_ns)
        if len(log_time_ns) > 1:
            self.longest_gap_ns = max(self.longest_gap_ns, int(np.diff(log_time_ns).max()))
        self.last_log_ns = last


def stamp_at(data: bytes, start: int) -> int:
    """Return the stamp in ns of a CDR message whose first field is one."""
    order: Literal["little", "big"] = "little" if data[start + 1 : start + 2] == b"\x01" else "big"
    sec = int.from_bytes(data[start + 4 : start + 8], order, signed=True)
    return sec * NANOSECONDS + int.from_bytes(data[start + 8 : start + 12], order)
