"""What happened to a node during a run, as its record tells it: changes of parameters and resets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from trunk_msgs_util.declarations import Value, build, values_of
from trunk_msgs_util.recording import Recording


@dataclass(frozen=True)
class Change:
    """What happened between two states: it takes effect on the first state after the stamp."""

    stamp_ns: int
    values: Mapping[str, Value] | None  # None: a reset


class Tunable(Protocol):
    """A controller or a simulation."""

    def retune(self, config: Any) -> None:
        """Take a new configuration."""

    def reset(self) -> None:
        """Forget the past."""


class Timeline:
    """A node's configuration as the stamps go by."""

    def __init__(self, config: Any, changes: Iterable[Change] = ()) -> None:
        self.config = config
        self._changes = sorted(changes, key=lambda change: change.stamp_ns, reverse=True)

    def advance(self, stamp_ns: int, target: Tunable | None = None) -> bool:
        """Apply, also to ``target``, what takes effect on the state with this stamp; True if any did."""
        applied = False
        while self._changes and self._changes[-1].stamp_ns < stamp_ns:
            applied = True
            values = self._changes.pop().values
            if values is not None:
                self.config = build(type(self.config), {**values_of(self.config), **values})
                if target is not None:
                    target.retune(self.config)
            elif target is not None:
                target.reset()
        return applied


def changes_of(recording: Recording, node: str) -> list[Change]:
    """Return a node's changes of parameters and resets."""
    name = recording.topic(node)
    changes = [
        Change(change.stamp_ns, change.changed)
        for change in recording.parameter_changes()
        if change.node == name
    ]
    resets = [
        Change(event.stamp_ns, None)
        for event in recording.events()
        if event.node == name and event.message == "reset"
    ]
    return changes + resets
