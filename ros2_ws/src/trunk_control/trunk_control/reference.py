"""Reference profiles: constant, step, sine, levels, and lines between points, as functions of the stamp.

Pure: scalar functions of integers, floats and tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from trunk_msgs_util.elementary import sine_wave
from trunk_msgs_util.units import held, interpolated

PROFILES = ("constant", "step", "sine", "sequence", "interpolated")
CONSTANT, STEP, SINE, SEQUENCE, INTERPOLATED, TOPIC = range(6)


class ReferenceProfile(NamedTuple):
    """A profile's parameters; angles in rad, times in ns, the frequency in Hz."""

    kind: int = CONSTANT
    value: float = 0.0
    initial: float = 0.0
    step_time: int = 0
    amplitude: float = 0.0
    frequency: float = 0.0
    times: Sequence[int] = ()
    values: Sequence[float] = ()


def reference_at(t_ns: int, p: ReferenceProfile) -> float:
    """Return the reference in rad at a stamp in ns.

    ::

        constant       value
        step           initial before step_time, value from then on
        sine           value + amplitude sin(2 pi frequency t)
        sequence       initial before times[0], then values[i] from times[i] on
        interpolated   values[0] before times[0], linear between the points, then the last value
        topic          value, until a message arrives

    ``interpolated`` needs at least one point; `time_table.interpolated` has its formula.
    """
    if p.kind == CONSTANT or p.kind == TOPIC:
        return p.value
    if p.kind == STEP:
        return p.value if t_ns >= p.step_time else p.initial
    if p.kind == SINE:
        return p.value + p.amplitude * sine_wave(p.frequency * (t_ns / 1_000_000_000), 0.0)
    if p.kind == INTERPOLATED:
        return interpolated(t_ns, p.times, p.values, p.values[0])
    return held(t_ns, p.times, p.values, p.initial)
