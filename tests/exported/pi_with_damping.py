"""PI with damping, and a short history in its memory: a law as somebody else writes it."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from trunk_control.api import ControllerConfig, Law, Limits, Sample, limited, parameter, sin, usable


@dataclass(frozen=True)
class Config(ControllerConfig):
    """Its parameters."""

    p: float = parameter("p", 60.0, "Gain", unit="N m/rad", minimum=0.0, maximum=1e6)
    i: float = parameter("i", 100.0, "Integral gain", unit="N m/(rad s)", minimum=0.0, maximum=1e6)
    d: float = parameter("d", 8.0, "Damping", unit="N m s/rad", minimum=0.0, maximum=1e6)
    uses_rate = True
    constants = property(lambda self: (self.p, self.i, self.d))


class Memory(NamedTuple):
    """Between updates."""

    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad/s, the newest first
    integral: float = 0.0  # N m
    effort: float = 0.0  # N m


class Terms(NamedTuple):
    """One update."""

    integral: float  # N m
    unsaturated: float  # N m
    effort: float  # N m
    held: bool


def mean_of(rates: tuple[float, float, float]) -> float:
    """Return the mean of three rates, the newest twice."""
    total = rates[0]
    for rate in rates:
        total += rate
    return total / 4.0


def update(
    memory: Memory, sample: Sample, constants: tuple[float, ...], limits: Limits
) -> tuple[Memory, Terms]:
    """Return one update."""
    p, i, d = constants
    error = sample.reference - sample.measurement
    rates = (sample.rate, *memory.rates[:-1])
    integral = memory.integral + i * error * sample.dt
    wanted = p * error - d * mean_of(rates) + integral - 2.0 * sin(sample.reference)
    if not usable(error, wanted, sample.dt):
        return memory, Terms(memory.integral, memory.effort, limited(memory.effort, limits), True)
    effort = limited(wanted, limits)
    if effort != wanted:
        integral = memory.integral
    return Memory(rates, integral, effort), Terms(integral, wanted, effort, False)


def reconfigure(memory: Memory, sample: Sample, before: Any, after: Any) -> Memory:
    """Return the memory whose integral takes up what new gains change."""
    error = sample.reference - sample.measurement
    change = (before[0] - after[0]) * error - (before[2] - after[2]) * mean_of(memory.rates)
    return memory._replace(integral=memory.integral + change)


LAW = Law(
    "pi_with_damping",
    "PI with damping",
    Config,
    update,
    Memory(),
    Terms,
    {"integral": "N m"},
    reconfigure=reconfigure,
)
