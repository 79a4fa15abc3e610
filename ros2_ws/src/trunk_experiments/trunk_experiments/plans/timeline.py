"""What happened to a node during a recorded run: parameter changes, resets, turns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Protocol

from trunk_control.controller import Controller
from trunk_control.controller_config import ControllerConfig
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value, build, values_of


@dataclass(frozen=True)
class Change:
    """What happened between two states: it takes effect on the first state after the stamp."""

    stamp_ns: int
    values: Mapping[str, Value] | None  # of parameters; None: an event
    event: str = Event.RESET


class Tunable(Protocol):
    """A controller or a simulation."""

    def reconfigure(self, config: Any) -> None:
        """Change the configuration."""

    def reset(self) -> None:
        """Forget the past."""


class Timeline:
    """A node's configuration as time advances from stamp to stamp."""

    def __init__(
        self,
        config: Any,
        changes: Iterable[Change] = (),
        seen: Callable[[int], float | None] = lambda _stamp_ns: None,
    ) -> None:
        """``seen`` returns the angle [rad] that a controller saw at the last stamp before it became active.

        A controller that is shown every state does not need it.
        """
        self.config = config
        self._seen = seen
        # The next change last; changes between the same two states keep their order.
        self._changes = sorted(changes, key=lambda change: change.stamp_ns)[::-1]

    @property
    def to_come(self) -> list[Change]:
        """The changes that have not been applied yet, in their order."""
        return self._changes[::-1]

    @property
    def next_ns(self) -> float:
        """The stamp after which the next change takes effect; infinite if there is none."""
        return self._changes[-1].stamp_ns if self._changes else inf

    def advance(self, stamp_ns: int, target: Tunable | None = None) -> bool:
        """Apply, also to ``target``, what takes effect on the state with this stamp; True if anything did."""
        applied = False
        while self._changes and self._changes[-1].stamp_ns < stamp_ns:
            applied = True
            change = self._changes.pop()
            if change.values is not None:
                self.config = build(type(self.config), {**values_of(self.config), **change.values})
                if target is not None:
                    target.reconfigure(self.config)
            elif change.event == Event.RESET:
                if target is not None:
                    target.reset()
            elif isinstance(target, Controller):
                if change.event == Event.ACTIVATED:
                    position = self._seen(change.stamp_ns)
                    if position is not None:
                        target.see(change.stamp_ns, position)
                    target.activate()
                else:
                    if change.event == Event.CLEANED_UP:
                        target.forget()
                    target.deactivate()
        return applied


def begins_active(config: ControllerConfig, changes: Iterable[Change]) -> bool:
    """Return True if a controller acts from the first state on although no event says so."""
    turns = (Event.ACTIVATED, Event.DEACTIVATED)
    first = next((change.event for change in changes if change.event in turns), None)
    return config.autostart and not config.active_times and first != Event.ACTIVATED
