"""Messages that cannot be read: how many on a topic, and where the first ones are."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from ..units import seconds
from .joint_arrays import groups, misfit, sample
from .limits import MAX_JOINTS, MAX_LAYOUTS, MAX_UNUSUAL, LimitError, check_table

if TYPE_CHECKING:
    from .joint_arrays import Integers
    from .joint_state_cdr import JointStateLayout
    from .messages import Messages

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
class Faults:
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
        found, strange = groups(messages)
        bad: list[tuple[int, str]] = []
        for layout, rows in found:
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
