"""`Topic`: what is recorded on one topic, counted as its messages are scanned; what cannot be read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .. import topics as names
from ..errors import TrunkError
from ..units import NANOSECONDS, seconds
from .joint_arrays import groups, misfit, sample
from .limits import MAX_JOINTS, MAX_LAYOUTS, MAX_UNUSUAL, LimitError, check_table
from .messages import unaligned

if TYPE_CHECKING:
    from .joint_arrays import Integers
    from .joint_state_cdr import JointStateLayout
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


class RecordingError(TrunkError):
    """The file cannot be used as a recording: one line that names it and says what to do."""


_PLACES = 3  # listed for a topic


class BadMessage(NamedTuple):
    """A message that cannot be read: the topic's message ``number``, counted from 0, and why."""

    number: int
    log_time_ns: int
    why: str

    def describe(self) -> str:
        """Return place and reason, as a phrase."""
        logged = f", logged at {seconds(self.log_time_ns):.9f} s" if self.log_time_ns >= 0 else ""
        return f"message {self.number}{logged}: {self.why}"


@dataclass
class Unreadable:
    """What cannot be read on a topic. ``limit``: why none of its messages are."""

    count: int = 0
    first: list[BadMessage] = field(default_factory=list)
    limit: str | None = None

    def add(self, number: int, log_time_ns: int, why: str) -> None:
        """Count a message that cannot be read."""
        self.count += 1
        if len(self.first) < _PLACES:
            self.first.append(BadMessage(number, log_time_ns, " ".join(why.split())))

    def describe(self, topic: str, messages: int) -> str:
        """Return a line about a topic of so many messages."""
        if self.limit is not None:
            return f"{topic} is not read: {self.limit}"
        places = "; ".join(bad.describe() for bad in self.first)
        more = f" (the first {_PLACES} of them: " if self.count > _PLACES else " ("
        return f"{topic}: {self.count} of {messages} messages cannot be read{more}{places})"


class JointCheck:
    """Looks through a JointState topic, block by block, before any of its values is used."""

    def __init__(self) -> None:
        self._layouts: set[JointStateLayout] = set()
        self._names: set[str] = set()
        self._last: JointStateLayout | None = None
        self._unusual = self._messages = self._size = 0

    def bad(self, messages: Messages) -> list[tuple[int, str]]:
        """Return the rows that cannot be read, and why. Raises LimitError for the whole topic."""
        self._messages += len(messages)
        sizes = messages.end - messages.start
        self._size += int(sizes.sum())
        check_table(self._messages, len(self._names), self._size)
        if self._is_as_before(messages, sizes):
            return []
        layouts, strange = groups(messages)
        bad: list[tuple[int, str]] = []
        for layout, rows in layouts:
            why = misfit(layout)
            if why:
                bad += [(row, why) for row in rows.tolist()]
            elif layout not in self._layouts:
                self._layouts.add(layout)
                self._names.update(layout.name)
            if not why:
                self._last = layout
        self._unusual += len(strange)
        if self._unusual > MAX_UNUSUAL:
            raise LimitError(
                f"more than {MAX_UNUSUAL} of its messages are malformed or not little-endian"
            )
        for row in strange:
            try:
                self._names.update(sample(messages, row).name)
            except ValueError as error:
                bad.append((row, str(error)))
        if len(self._layouts) > MAX_LAYOUTS:
            raise LimitError(f"its messages have more than {MAX_LAYOUTS} layouts")
        if len(self._names) > MAX_JOINTS:
            raise LimitError(f"its messages name more than {MAX_JOINTS} joints")
        check_table(self._messages, len(self._names), self._size)
        return sorted(bad)

    def _is_as_before(self, messages: Messages, sizes: Integers) -> bool:
        """Return True if all messages have the layout of the ones before: most do."""
        layout = self._last
        if layout is None or (sizes != layout.size).any():
            return False
        try:
            layout.decode_at(messages.data, messages.start)
        except ValueError:
            return False
        return True


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
    unreadable: Unreadable = field(default_factory=Unreadable)
    _check: JointCheck = field(default_factory=JointCheck, repr=False, compare=False)

    @property
    def readable(self) -> int:
        """How many of the messages can be read, as far as they were looked at."""
        return 0 if self.unreadable.limit is not None else self.count - self.unreadable.count

    def is_read(self) -> str:
        """Return why messages of this topic are not read by their type; empty if they are."""
        return "" if self.encoding in (CDR, "") else f"encoded as {self.encoding}, only cdr is read"

    def take(self, messages: Messages) -> list[int]:
        """Count some messages that follow the earlier ones; return the rows that cannot be read."""
        bad = self._bad(messages)
        for row, why in bad:
            self.unreadable.add(self.count + row, int(messages.log_time_ns[row]), why)
        rows = [row for row, _ in bad]
        good = messages.without(rows) if rows else messages
        self.count += len(messages)
        self.size += int((messages.end - messages.start).sum())
        if len(good):
            self.take_stamps(good)
            self.take_log(good.log_time_ns)
        return rows

    def _bad(self, messages: Messages) -> list[tuple[int, str]]:
        late = np.flatnonzero(messages.log_time_ns < 0).tolist()
        if late:  # what else may be wrong with these is not asked
            return self._bad_of(messages.without(late), late)
        return self._bad_of(messages, late)

    def _bad_of(self, messages: Messages, late: list[int]) -> list[tuple[int, str]]:
        """Return the rows that cannot be read, the ``late`` ones, which are not among these, included."""
        late_rows = [(row, "its log time is beyond the year 2262") for row in late]
        if (
            self.type != names.JOINT_STATE_TYPE
            or self.is_read()
            or self.unreadable.limit is not None
        ):
            return late_rows
        if not len(messages):
            return late_rows
        try:
            bad = self._check.bad(messages)
        except LimitError as error:
            self.unreadable.limit = str(error)
            return late_rows
        if not late:
            return bad
        kept = np.delete(np.arange(len(messages) + len(late)), late)
        return sorted([*late_rows, *((int(kept[row]), why) for row, why in bad)])

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
    start = messages.start[messages.end - messages.start >= _STAMP.itemsize]
    fields = unaligned(messages.data, _STAMP)[start]
    little = fields["order"] == 1
    if little.all():  # as almost always
        return fields["sec"].astype(np.int64), fields["nanosec"].astype(np.int64)
    big = fields.view(_STAMP.newbyteorder(">"))
    sec, nanosec = (np.where(little, fields[name], big[name]) for name in ("sec", "nanosec"))
    return sec.astype(np.int64), nanosec.astype(np.int64)
