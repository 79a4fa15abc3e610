"""Pushes: rectangular pulses, added to the disturbances that a run has anyway."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from trunk_msgs_util.parameters.declarations import UnitError, Value, build, values_of
from trunk_msgs_util.parameters.to_si import number_in
from trunk_msgs_util.units import held, nanoseconds, seconds
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import CHANNELS

from ..errors import PlanError

UNITS = dict(zip(CHANNELS, ("N", "N m", "m", "rad"), strict=True))
_USUAL = "trunk_effort"


class Push(NamedTuple):
    """A constant value on a channel for a while; times in s, the value in the channel's unit."""

    channel: str
    value: float
    start: float
    duration: float


def parse_push(text: str, at: float) -> Push:
    """Return the push that ``[CHANNEL=]VALUE:DURATION[@TIME]`` means; without a time it starts at ``at`` s.

    Raises PlanError.
    """
    push_text, _, time_text = text.partition("@")
    channel, equals, amount = push_text.rpartition("=")
    channel = channel if equals else _USUAL
    value_text, colon, duration_text = amount.partition(":")
    needed = (
        f"--push {text!r}: [CHANNEL=]VALUE:DURATION[@TIME] is needed, such as 60Nm:0.1s or "
        f"hip_effort=300N:50ms@2.5s, CHANNEL one of {', '.join(CHANNELS)}"
    )
    if channel not in CHANNELS or not colon:
        raise PlanError(needed)
    try:
        value = number_in(value_text, UNITS[channel])
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
    pushes = [parse_push(text, 0.0) for text in texts]
    for text, push in zip(texts, pushes, strict=True):
        if push.start > end:
            raise PlanError(f"--push {text!r}: the run ends at {end:g} s: give an earlier time")
    return build(DisturbanceConfig, {**values_of(config), **pushed(config, pushes)})


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
