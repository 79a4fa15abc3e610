"""The latest events of a run, with what was changed of a node's parameters. Pure."""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from trunk_msgs_util.events import Event
from trunk_msgs_util.units import seconds

from ..analysis.parameter_text import transitions_text

if TYPE_CHECKING:
    from collections.abc import Mapping

_DRAG_S = 2.0  # between two values of a slider that is dragged, at ten times real time


@dataclass(eq=False)
class _Listed:
    number: int
    stamp_ns: int
    node: str
    event: str
    values: dict[str, str]
    before: Mapping[str, Any] = field(default_factory=dict)
    after: dict[str, Any] = field(default_factory=dict)
    changed: str = ""  # before and after, as text

    @property
    def t(self) -> float:
        return max(seconds(self.stamp_ns), 0.0)

    def take(self, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
        self.before = self.before or before
        self.after.update(after)
        self.changed = transitions_text(self.before, self.after)

    def as_values(self) -> dict[str, object]:
        names = ("number", "t", "node", "event", "values", "changed")
        return {name: getattr(self, name) for name in names}


class _Change(NamedTuple):
    stamp_ns: int
    before: Mapping[str, Any]
    after: Mapping[str, Any]


class _Unpaired:
    """A node's events and changes of parameters whose counterpart has not come yet."""

    def __init__(self, kept: int) -> None:
        self.events: deque[_Listed] = deque(maxlen=kept)
        self.changes: deque[_Change] = deque(maxlen=kept)


class EventList:
    """The last ``kept`` events. A slider that is dragged makes one."""

    def __init__(self, kept: int) -> None:
        self.dropped = 0
        self._kept = kept
        self._number = 0  # of the last event
        self._events: deque[_Listed] = deque(maxlen=kept)
        self._unpaired: defaultdict[str, _Unpaired] = defaultdict(lambda: _Unpaired(kept))

    def add(self, node: str, stamp_ns: int, message: str, values: Mapping[str, str]) -> None:
        """Take an event."""
        self._number += 1
        self.dropped += len(self._events) == self._kept
        self._events.append(_Listed(self._number, stamp_ns, node, message, dict(values)))
        if message == Event.RETUNED:
            self._unpaired[node].events.append(self._events[-1])
            self._pair(node)

    def change(
        self, node: str, stamp_ns: int, before: Mapping[str, Any], after: Mapping[str, Any]
    ) -> None:
        """Take a change of parameters. ``before``: all of the node's, before it; ``after``: the new ones."""
        self._unpaired[node].changes.append(_Change(stamp_ns, dict(before), after))
        self._pair(node)

    def as_values(self) -> list[dict[str, object]]:
        """Return the events, the oldest first."""
        return [event.as_values() for event in self._events]

    def _pair(self, node: str) -> None:
        """Give the node's events their changes: in order and by stamp, as either topic may be ahead."""
        events, changes = self._unpaired[node].events, self._unpaired[node].changes
        while events and changes:
            if events[0].stamp_ns < changes[0].stamp_ns:  # its counterpart was lost
                events.popleft()
            elif events[0].stamp_ns > changes[0].stamp_ns:
                changes.popleft()
            else:
                event, change = events.popleft(), changes.popleft()
                event.take(change.before, change.after)
                self._join_drag(event)

    def _join_drag(self, event: _Listed) -> None:
        """Let the event before go on to this one, if both belong to one drag."""
        place = next((i for i, other in enumerate(self._events) if other is event), 0)
        earlier = self._events[place - 1]
        if (
            place
            and event.after
            and earlier.node == event.node
            and earlier.after.keys() == event.after.keys()
            and abs(seconds(event.stamp_ns - earlier.stamp_ns)) <= _DRAG_S
        ):
            earlier.take(event.before, event.after)
            earlier.stamp_ns = event.stamp_ns
            del self._events[place]
