"""`Topic`: what is recorded on one topic, counted as its messages are scanned; what cannot be read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from .. import topics as names
from ..units import NANOSECONDS, seconds
from .joint_table import UnreadableError, pieces
from .messages import unaligned

if TYPE_CHECKING:
    from .joint_state_cdr import JointStateLayout
    from .joint_table import Integers, Piece
    from .messages import Messages

# These types begin with a stamp, right after the encapsulation header.
STAMPED = (
    names.JOINT_STATE_TYPE,
    names.PARAMETER_EVENT_TYPE,
    names.DIAGNOSTIC_ARRAY_TYPE,
    names.CLOCK_TYPE,
)


CDR = "cdr"
_STAMP = np.dtype(
    {
        "names": ["order", "sec", "nanosec"],
        "formats": ["u1", "<i4", "<u4"],
        "offsets": [1, 4, 8],
        "itemsize": 12,
    }
)
STAMP_SIZE = _STAMP.itemsize


@dataclass
class Topic:
    """What is recorded on a topic; stamps are the headers', or else the log times.

    First and last are the earliest and the latest: MCAP gives messages no order.
    """

    type: str
    encoding: str = CDR
    count: int = 0
    first_stamp_ns: int | None = None
    last_stamp_ns: int | None = None
    size: int = 0  # encoded bytes
    last_log_ns: int | None = None
    longest_gap_ns: int = 0  # between the log times of consecutive messages, if `ordered`
    ordered: bool = True  # no message was logged before the one that precedes it in the file
    # Of the stamps in the order of the file, where all of them were read:
    rising: bool = field(default=True, compare=False)
    longest_step_ns: int = field(default=0, compare=False)
    overflowing: int = field(default=0, compare=False)  # their nanoseconds make a second or more
    _previous_ns: int | None = field(default=None, repr=False, compare=False)
    unreadable: str = ""  # a message that cannot be read, and why: none is read
    # Of a JointState topic's messages, in the order of the file, each with its frame:
    layouts: dict[JointStateLayout, None] = field(default_factory=dict, repr=False, compare=False)

    @property
    def readable(self) -> int:
        """How many of the messages can be read, as far as they were looked at."""
        return 0 if self.unreadable else self.count

    def is_read(self) -> str:
        """Return why messages of this topic are not read by their type; empty if they are."""
        return "" if self.encoding in (CDR, "") else f"encoded as {self.encoding}, only cdr is read"

    def refuse(self, number: int, log_time_ns: int, why: str) -> None:
        """Note that a message cannot be read, the topic's ``number``, counted from 0."""
        logged = f", logged at {seconds(log_time_ns):.9f} s" if log_time_ns >= 0 else ""
        self.unreadable = self.unreadable or f"message {number}{logged}: {' '.join(why.split())}"

    def take(self, messages: Messages) -> list[Piece] | None:
        """Count some messages that follow the earlier ones; return a JointState topic's by layouts.

        None if they are not to be read.
        """
        parts, log = None, messages.log_time_ns
        if (log < 0).any():
            row = int(np.argmax(log < 0))
            self.refuse(self.count + row, -1, "its log time is beyond the year 2262")
        if self.type == names.JOINT_STATE_TYPE and not (self.unreadable or self.is_read()):
            try:
                parts = pieces(messages)
                self.layouts |= dict.fromkeys(part.layout for part in parts)
            except UnreadableError as error:
                self.refuse(self.count + error.row, int(log[error.row]), str(error))
        self.count += len(messages)
        self.size += int((messages.end - messages.start).sum())
        if len(messages) and (self.is_read() or not self.unreadable):
            self.take_stamps(messages)
            self.take_log(log)
        return None if self.unreadable else parts

    def take_stamps(self, messages: Messages) -> None:
        """Take account of the stamps of one or more messages."""
        stamps = messages.log_time_ns
        if self.type in STAMPED and not self.is_read():
            sec, nanosec = fields_of(messages)
            stamps = sec * NANOSECONDS + nanosec
            self.overflowing += int(np.count_nonzero(nanosec >= NANOSECONDS))
        if len(stamps):
            before = [] if self._previous_ns is None else [self._previous_ns]
            steps = np.diff(np.append(np.array(before, np.int64), stamps))
            if len(steps):
                self.rising = self.rising and bool(steps.min() > 0)
                self.longest_step_ns = max(self.longest_step_ns, int(steps.max()))
            self._previous_ns = int(stamps[-1])
            first, last = int(stamps.min()), int(stamps.max())
            if self.first_stamp_ns is not None and self.last_stamp_ns is not None:
                first, last = min(first, self.first_stamp_ns), max(last, self.last_stamp_ns)
            self.first_stamp_ns, self.last_stamp_ns = first, last

    def take_log(self, log_time_ns: Integers) -> None:
        """Take account of the log times of one or more messages that follow the earlier ones."""
        before = [] if self.last_log_ns is None else [self.last_log_ns]
        steps = np.diff(np.append(np.array(before, np.int64), log_time_ns))
        if len(steps):
            self.longest_gap_ns = max(self.longest_gap_ns, int(steps.max()))
            self.ordered = self.ordered and bool(steps.min() >= 0)
        self.last_log_ns = int(log_time_ns[-1])


def fields_of(messages: Messages) -> tuple[Integers, Integers]:
    """Return the stamps of CDR messages that begin with one, where they are long enough: s and ns."""
    start = messages.start[messages.end - messages.start >= STAMP_SIZE]
    fields = unaligned(messages.data, _STAMP)[start]
    little = fields["order"] == 1
    if little.all():  # as almost always
        return fields["sec"].astype(np.int64), fields["nanosec"].astype(np.int64)
    big = fields.view(_STAMP.newbyteorder(">"))
    sec, nanosec = (np.where(little, fields[name], big[name]) for name in ("sec", "nanosec"))
    return sec.astype(np.int64), nanosec.astype(np.int64)
