"""Two laws of a package of their own, whose memories are not the PID's."""

from dataclasses import dataclass
from typing import NamedTuple

from trunk_control.api import ControllerConfig, Law, Limits, Sample, limited, parameter, usable


class Terms(NamedTuple):
    error: float
    unsaturated: float
    effort: float
    held: bool


@dataclass(frozen=True)
class CountingConfig(ControllerConfig):
    p: float = parameter("p", 60.0, "Per angle", unit="N m/rad", minimum=0.0, maximum=1e6)
    i: float = parameter(
        "i", 40.0, "Per its integral", unit="N m/(rad s)", minimum=0.0, maximum=1e6
    )
    d: float = parameter("d", 9.0, "Per rate", unit="N m s/rad", minimum=0.0, maximum=1e6)
    uses_rate = True
    constants = property(lambda self: (self.p, (self.i, self.d, 3)))


class Past(NamedTuple):
    updates: int = 0  # as far as they count
    errors: tuple[float, float] = (0.0, 0.0)  # rad, the last and the one before


class Counting(NamedTuple):
    saturated: bool = False
    effort: float = 0.0  # N m
    past: Past = Past()
    integral: float = 0.0  # N m


def count(
    memory: Counting,
    sample: Sample,
    constants: tuple[float, tuple[float, float, int]],
    limits: Limits,
) -> tuple[Counting, Terms]:
    """Return a PID's update: its rate is of three errors as soon as there are three, else as measured."""
    p, (i, d, enough) = constants
    past, dt = memory.past, sample.dt
    error = sample.reference - sample.measurement
    if not usable(error, sample.rate, dt):
        return memory, Terms(0.0, memory.effort, limited(memory.effort, limits), True)
    last, before = past.errors
    rate = -sample.rate
    if past.updates >= enough:
        rate = 0.5 * rate + 0.5 * ((error - last) + 0.5 * (last - before)) / (1.5 * dt)
    integral = memory.integral + (0.0 if memory.saturated else i * dt * error)
    wanted = p * error + integral + d * rate
    total = wanted + integral
    if total - total != 0.0:
        return memory, Terms(0.0, memory.effort, limited(memory.effort, limits), True)
    effort = limited(wanted, limits)
    updates = past.updates + 1 if past.updates < enough else enough
    after = Counting(effort != wanted, effort, Past(updates, (error, last)), integral)
    return after, Terms(error, wanted, effort, False)


@dataclass(frozen=True)
class PlainConfig(ControllerConfig):
    p: float = parameter("p", 70.0, "Per angle", unit="N m/rad", minimum=0.0, maximum=1e6)
    d: float = parameter("d", 9.0, "Per rate", unit="N m s/rad", minimum=0.0, maximum=1e6)
    uses_rate = True
    hip = property(lambda self: "hip")
    constants = property(lambda self: (self.p, self.d))


class Plain(NamedTuple):
    effort: float = 0.0  # N m


def keep_upright(
    memory: Plain, sample: Sample, constants: tuple[float, float], limits: Limits
) -> tuple[Plain, Terms]:
    """Return a PD's update, a little ahead of the hip."""
    p, d = constants
    error = sample.reference - sample.measurement
    wanted = p * error - d * sample.rate + 0.1 * sample.hip.velocity
    if not usable(error, wanted, sample.dt):
        return memory, Terms(0.0, memory.effort, limited(memory.effort, limits), True)
    effort = limited(wanted, limits)
    return Plain(effort), Terms(error, wanted, effort, False)


UNITS = {"error": "rad"}
COUNTING = Law("counting", "Counting", CountingConfig, count, Counting(), Terms, UNITS)
PLAIN = Law("plain", "Plain", PlainConfig, keep_upright, Plain(), Terms, UNITS)
