"""Reference profiles: constant, step, sine, levels, lines between points; the parameters that describe them.

Up to `reference_at` pure: scalar functions of integers, floats and tuples, which CPython runs and numba
compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from trunk_core.elementary import sine_wave
from trunk_core.parameters.declarations import (
    MOST_ROWS,
    ParameterError,
    TableFile,
    check_rows,
    parameter,
    times_parameter,
)
from trunk_core.parameters.shared import PeriodicConfig, lockstep_parameter, rate_parameter
from trunk_core.units import held, interpolated, nanoseconds

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

    ``interpolated`` needs at least one point; `units.interpolated` has its formula.
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


REFERENCE_PROFILES = (*PROFILES, "topic")  # in the order of their kinds


@dataclass(frozen=True)
class ReferenceConfig(PeriodicConfig):
    """Parameters of the ``reference`` node; controllers have the same."""

    table_files: ClassVar[tuple[TableFile, ...]] = (
        TableFile("reference", "reference", ("interpolated", "sequence")),
    )

    update_rate: float = rate_parameter(
        "Rate of the plant's steps, for which there is one reference each"
    )
    lockstep: bool = lockstep_parameter("The plant waits for each step's reference")
    joint: str = parameter("joint", "trunk", "The joint that is controlled", fixed=True)
    reference_profile: str = parameter(
        "reference.profile",
        "constant",
        "Shape of the reference; topic: the latest message on the reference topic, the value until then",
        choices=REFERENCE_PROFILES,
    )
    reference_value: float = parameter(
        "reference.value",
        0.0,
        "Constant, final value of the step, or mean of the sine",
        unit="rad",
        minimum=-1e3,
        maximum=1e3,
    )
    reference_initial: float = parameter(
        "reference.initial",
        0.0,
        "Before the step, or before the sequence begins",
        unit="rad",
        minimum=-1e3,
        maximum=1e3,
    )
    reference_step_time: float = parameter(
        "reference.step_time", 2.0, "Time of the step", unit="s", minimum=0.0, maximum=1e6
    )
    reference_amplitude: float = parameter(
        "reference.amplitude", 0.0, "Amplitude of the sine", unit="rad", minimum=-1e3, maximum=1e3
    )
    reference_frequency: float = parameter(
        "reference.frequency", 0.5, "Frequency of the sine", unit="Hz", minimum=0.0, maximum=1e5
    )
    reference_times: tuple[float, ...] = times_parameter(
        "reference.times",
        "When the levels of the sequence begin, or the times of the points, ascending",
    )
    reference_values: tuple[float, ...] = parameter(
        "reference.values",
        (),
        "The levels of the sequence, or the values of the points",
        unit="rad",
        element=float,
        longest=MOST_ROWS,
        minimum=-1e3,
        maximum=1e3,
    )

    def __post_init__(self) -> None:
        check_rows("reference", self.reference_times, self.reference_values)
        if self.reference_profile == "interpolated" and not self.reference_times:
            raise ParameterError(
                "reference.profile", "interpolated", "at least one of reference.times is needed"
            )

    @property
    def reference(self) -> ReferenceProfile:
        """The profile that `reference_at` evaluates."""
        return ReferenceProfile(
            REFERENCE_PROFILES.index(self.reference_profile),
            self.reference_value,
            self.reference_initial,
            nanoseconds(self.reference_step_time),
            self.reference_amplitude,
            self.reference_frequency,
            tuple(nanoseconds(t) for t in self.reference_times),
            self.reference_values,
        )
