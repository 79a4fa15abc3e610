"""What happens during a run besides what its configurations say.

Changes of a node's parameters, resets and turns; pushes that a plan adds to the disturbances, and what an
operator does.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, NamedTuple, Protocol

import numpy as np

from trunk_control.controller import Controller
from trunk_control.law import ControllerConfig
from trunk_core.arrays import Floats, Integers
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import UnitError, Value, build, values_of
from trunk_core.parameters.to_si import number_in
from trunk_core.topics import Event
from trunk_core.units import held, nanoseconds, seconds
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.inputs import NOTHING, Applied, OperatorLimits
from trunk_sim.plant import Plant


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


class Push(NamedTuple):
    """A constant value on a channel for a while; times in s, the value in the channel's unit."""

    channel: str
    value: float
    start: float
    duration: float


def parse_push(text: str, at: float, plant: Plant) -> Push:
    """Return the push that ``[CHANNEL=]VALUE:DURATION[@TIME]`` means; without a time it starts at ``at`` s.

    Raises PlanError.
    """
    push_text, _, time_text = text.partition("@")
    channel, equals, amount = push_text.rpartition("=")
    units = plant.channel_units
    channel = channel if equals else plant.channels[plant.drive]
    value_text, colon, duration_text = amount.partition(":")
    needed = (
        f"--push {text!r}: [CHANNEL=]VALUE:DURATION[@TIME] is needed, such as 60Nm:0.1s or "
        f"{plant.channels[0]}=300{units[plant.channels[0]].replace(' ', '')}:50ms@2.5s, "
        f"CHANNEL one of {', '.join(units)}"
    )
    if channel not in units or not colon:
        raise PlanError(needed)
    try:
        value = number_in(value_text, units[channel])
        duration = number_in(duration_text, "s")
        start = number_in(time_text, "s") if "@" in text else at
    except UnitError as error:
        raise PlanError(f"{needed}: {error}") from None
    if not (0.0 < duration < 1e6 and nanoseconds(duration) and abs(value) <= 1e9):
        raise PlanError(f"{needed}; DURATION above 0 s")
    if not at <= start < 1e6:
        raise PlanError(f"--push {text!r}: it starts at {start:g} s: give a time from {at:g} s on")
    return Push(channel, value, start, duration)


def valued(push: str, value: str) -> str:
    """Return ``[CHANNEL=]DURATION[@TIME]`` with a value, for `parse_push`. Raises PlanError if it has one."""
    channel, equals, rest = push.rpartition("=")
    rest = rest.removeprefix(":")
    if ":" in rest:
        raise PlanError(f"--push {push!r}: its value varies: leave it out, such as 0.1s@3")
    return f"{channel}{equals}{value}:{rest}"


def with_pushes(config: DisturbanceConfig, texts: Sequence[str], end: float) -> DisturbanceConfig:
    """Return a disturbance with the pushes of a run to ``end`` s; one without a time acts from 0 s on.

    Raises PlanError.
    """
    pushes = [parse_push(text, 0.0, config.kind) for text in texts]
    for text, push in zip(texts, pushes, strict=True):
        if push.start > end:
            raise PlanError(f"--push {text!r}: the run ends at {end:g} s: give an earlier time")
    return build(type(config), {**values_of(config), **pushed(config, pushes)})


def pushed(config: DisturbanceConfig, pushes: Sequence[Push]) -> Mapping[str, Value]:
    """Return the parameters of a disturbance that make its pushes act, and change nothing else.

    They go into its table if that is free, or is held between rows on the same channel; otherwise, if they
    are alike and it has no pulses, they become its pulses. Raises PlanError if neither is possible.
    """
    channels = {push.channel for push in pushes}
    free = not any(config.table_values)
    holds = config.table_interpolation == "hold" and channels == {config.table_channel}
    if len(channels) == 1 and (free or holds):
        times, values = _held_table(config, pushes)
        return {
            "table.channel": pushes[0].channel,
            "table.times": times,
            "table.values": values,
            "table.interpolation": "hold",
        }
    alike = {push._replace(start=0.0) for push in pushes}
    no_pulses = not (config.pulse_start_times or config.pulse_random_count)
    if len(alike) == 1 and no_pulses:
        return {
            "pulse.channel": pushes[0].channel,
            "pulse.start_times": tuple(sorted(push.start for push in pushes)),
            "pulse.duration": pushes[0].duration,
            "pulse.magnitude": pushes[0].value,
        }
    raise PlanError(
        f"--push: {'one channel' if len(channels) > 1 else pushes[0].channel}: the disturbance has one table "
        f"({'free' if free else f'{config.table_interpolation} on {config.table_channel}'}) and one kind of "
        f"pulse ({'free' if no_pulses else 'in use'}): give pushes on one channel, or identical ones"
    )


def _held_table(
    config: DisturbanceConfig, pushes: Sequence[Push]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return times, s, and values of the table with the pushes added to it."""
    before = tuple(map(nanoseconds, config.table_times)) if any(config.table_values) else ()
    spans = [_span(push) for push in pushes]
    rows = sorted({*before, *(edge for span in spans for edge in span)})
    values = []
    for at_ns in rows:
        value = held(at_ns, before, config.table_values, 0.0)
        for push, (start, end) in zip(pushes, spans, strict=True):
            value += push.value if start <= at_ns < end else 0.0
        values.append(value)
    return tuple(map(seconds, rows)), tuple(values)


def _span(push: Push) -> tuple[int, int]:
    start = nanoseconds(push.start)
    return start, start + nanoseconds(push.duration)


Pushes = Sequence[tuple[int, Applied]]  # what was taken, and at which stamp [ns], ascending


class Operated:
    """A run's operator: each push holds until the next one, or until it is too old."""

    def __init__(self, pushes: Pushes, limits: OperatorLimits | None) -> None:
        """``limits``: None where nobody may push; then nothing acts."""
        self.pushes = tuple(pushes) if limits is not None else ()
        self._limits = limits
        self._stamps = [stamp_ns for stamp_ns, _ in self.pushes]

    def __bool__(self) -> bool:
        """Return True if there was one."""
        return bool(self.pushes)

    def at(self, stamp_ns: int) -> Applied:
        """Return the push that acts on the step from the state with this stamp."""
        row = bisect_right(self._stamps, stamp_ns) - 1
        if row < 0 or self._limits is None:
            return NOTHING
        since_ns, asked = self.pushes[row]
        return self._limits.apply(asked, since_ns, stamp_ns)

    def over(self, stamps: Integers) -> Floats:
        """Return the pushes that act on the steps from these states [N, 2]: N and N m."""
        return np.array([self.at(stamp_ns) for stamp_ns in stamps.tolist()]).reshape(-1, 2)


@dataclass(frozen=True)
class GivenInputs:
    """What a record alone tells of a run's first N states: which message acted when, who answered what.

    The wall clock decided it, or an external node. ``command_ns`` [N]: the state whose command is in
    force, -1: none. ``disturbance`` [N, 4]: in force; ``disturbance_ns`` [N]: its stamp, -1: none.
    ``answered``: by controller, the stamps of the states that it answered. ``disturbed``: the stamps of the
    disturbance node's messages. ``seen``: the angle [rad] in each state before which a controller became
    active, by stamp. ``command`` [N]: in force, N m; None: as the plan's controllers answer. ``references``:
    by stamp, rad, of an external node.
    """

    command_ns: Integers
    disturbance: Floats
    disturbance_ns: Integers
    answered: Mapping[str, Integers]
    disturbed: Integers
    seen: Mapping[int, float]
    command: Floats | None = None
    references: Mapping[int, float] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.command_ns)
