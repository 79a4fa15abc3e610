"""What `trunk controller check-node` plays at a node: states and references, phase by phase. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, exp, sin
from typing import NamedTuple

from trunk_msgs_util.units import NANOSECONDS

# The phases, in order. The first three are played twice, with a reset before the second time.
MOTION, REST, LARGE, GAP, REPEAT, SILENCE, RESET = (
    "motion",
    "rest",
    "large",
    "gap",
    "repeat",
    "silence",
    "reset",
)
_COUNTS = {MOTION: 100, REST: 10, LARGE: 20, GAP: 10}
_SKIPPED = 20  # states that are left out before the phase GAP
SILENT_S = 0.5


class Played(NamedTuple):
    """A state and its reference, as played; angles in rad, the hip's position in m."""

    phase: str
    again: bool  # True: the second time
    stamp_ns: int
    position: tuple[float, float]  # hip, trunk
    velocity: tuple[float, float]
    reference: float


def states_to_play(rate: float) -> Iterator[Played]:
    """Yield the states to play at ``rate`` Hz, without the silence and the reset between some of them.

    ::

        theta = 0.3 exp(-t) cos(4 t) in motion, 0 at rest, +-3 rad where it is large
    """
    period_ns = round(NANOSECONDS / rate)
    for again in (False, True):
        index = 0
        for phase in (MOTION, REST, LARGE):
            for _ in range(_COUNTS[phase]):
                yield _state(phase, again, index, period_ns)
                index += 1
        if again:
            return
        index += _SKIPPED
        for _ in range(_COUNTS[GAP]):
            yield _state(GAP, again, index, period_ns)
            index += 1
        yield _state(REPEAT, again, index - 1, period_ns)
        yield _state(SILENCE, again, index, period_ns)


def _state(phase: str, again: bool, index: int, period_ns: int) -> Played:
    stamp_ns = index * period_ns
    t = stamp_ns / NANOSECONDS
    decay = 0.3 * exp(-t)
    theta, rate = decay * cos(4.0 * t), -decay * (cos(4.0 * t) + 4.0 * sin(4.0 * t))
    if phase == REST:
        theta, rate = 0.0, 0.0
    if phase == LARGE:
        theta, rate = (3.0, 5.0) if index % 20 < 10 else (-3.0, -5.0)
    return Played(phase, again, stamp_ns, (t, theta), (1.0, rate), 0.0)
