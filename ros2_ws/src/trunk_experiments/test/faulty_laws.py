"""Laws with one fault each, and the check that has to find it."""

from __future__ import annotations

import math
import os
import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from trunk_control.api import ControllerConfig, Law, Limits, Sample, limited, parameter, sin, usable


@dataclass(frozen=True)
class Config(ControllerConfig):
    """Parameters of the faulty laws."""

    gain: float = parameter(
        "gain", 40.0, "Torque per rad", unit="N m/rad", minimum=0.0, maximum=1e6
    )
    uses_rate = True
    constants = property(lambda self: (self.gain,))


class Memory(NamedTuple):
    """The integral, and the last command."""

    integral: float = 0.0
    effort: float = 0.0


class Terms(NamedTuple):
    """Terms of an honest law."""

    error: float
    unsaturated: float
    effort: float
    held: bool


def honest(
    memory: Memory, sample: Sample, constants: tuple[float], limits: Limits
) -> tuple[Memory, Terms]:
    """Return one update of a PI with damping; every fault below changes something in it."""
    error = sample.reference - sample.measurement
    wanted = constants[0] * (error + memory.integral) - 8.0 * sample.rate
    integral = memory.integral + sample.dt * error
    total = wanted + integral
    if not usable(error, sample.rate, sample.dt) or total - total != 0.0:
        return memory, Terms(0.0, memory.effort, limited(memory.effort, limits), True)
    effort = limited(wanted, limits)
    return Memory(integral, effort), Terms(error, wanted, effort, False)


HONEST = Law("honest", "Honest", Config, honest, Memory(), Terms, {"error": "rad"})
FAULTS: dict[str, tuple[str, Law]] = {}


def mutant(check: str, **fields: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a law with this update, and the check that must find its fault."""

    def register(update: Callable[..., Any]) -> Callable[..., Any]:
        given = {
            "config": Config,
            "memory": Memory(),
            "terms": Terms,
            "units": {"error": "rad"},
            **fields,
        }
        FAULTS[update.__name__] = (
            check,
            Law(name=update.__name__, label="Faulty", update=update, **given),
        )
        return update

    return register


_calls = 0
_seen: list[float] = []
_offsets = np.zeros(3)


class _Box:
    value = 0.0


_box, _another_box = _Box(), _Box()


@mutant("source")
def counts_its_calls(memory, sample, constants, limits):
    global _calls  # noqa: PLW0603
    _calls += 1
    return honest(memory, sample, constants, limits)


@mutant("source")
def remembers_in_a_list(memory, sample, constants, limits):
    _seen.append(sample.measurement)
    return honest(memory, sample, constants, limits)


@mutant("source")
def remembers_in_itself(memory, sample, constants, limits):
    remembers_in_itself.last = sample.measurement
    return honest(memory, sample, constants, limits)


@mutant("source")
def remembers_in_a_default(memory, sample, constants, limits, seen=[]):  # noqa: B006
    return honest(memory, sample, constants, limits)


@mutant("source")
def reads_an_array(memory, sample, constants, limits):
    return honest(memory, sample._replace(reference=_offsets[0]), constants, limits)


@mutant("pure")
def remembers_in_an_object(memory, sample, constants, limits):
    _box.value += sample.dt
    return honest(
        memory, sample._replace(reference=sample.reference + _box.value), constants, limits
    )


@mutant("reset")
def survives_a_reset(memory, sample, constants, limits):
    _another_box.value += sample.dt
    return honest(
        memory, sample._replace(reference=sample.reference + _another_box.value), constants, limits
    )


@mutant("source")
def reads_the_clock(memory, sample, constants, limits):
    late = time.monotonic() < 0.0
    return honest(memory, sample, (0.0,) if late else constants, limits)


@mutant("source")
def draws_at_random(memory, sample, constants, limits):
    noise = 0.0 * random.random()
    return honest(memory, sample._replace(reference=sample.reference + noise), constants, limits)


@mutant("source")
def reads_the_environment(memory, sample, constants, limits):
    gain = float(os.getenv("GAIN", "40"))
    return honest(memory, sample, (gain,), limits)


@mutant("source")
def reads_a_file(memory, sample, constants, limits):
    with open(os.devnull) as file:  # noqa: PTH123
        file.read()
    return honest(memory, sample, constants, limits)


@mutant("source")
def prints(memory, sample, constants, limits):
    if sample.dt < 0.0:
        print(sample)
    return honest(memory, sample, constants, limits)


@mutant("portable")
def takes_the_machines_sine(memory, sample, constants, limits):
    wanted = sample.reference - 0.0 * math.sin(
        sample.reference if usable(sample.reference, 0.0, 1.0) else 0.0
    )
    return honest(memory, sample._replace(reference=wanted), constants, limits)


@mutant("portable")
def takes_numpys_exponential(memory, sample, constants, limits):
    return honest(memory, sample, (constants[0] * float(np.exp(0.0)),), limits)


@mutant("portable")
def takes_a_power(memory, sample, constants, limits):
    return honest(memory, sample, (constants[0] ** 1.5,), limits)


@mutant("portable")
def takes_a_square(memory, sample, constants, limits):
    return honest(memory, sample, (constants[0] ** 2,), limits)


@mutant("portable")
def takes_a_cube(memory, sample, constants, limits):
    gain = constants[0]
    gain **= 3
    return honest(memory, sample, (gain,), limits)


@mutant("portable")
def takes_a_power_of_a_constant(memory, sample, constants, limits):
    return honest(memory, sample, (constants[0] * 1.1**7,), limits)


@mutant("types")
def returns_other_terms(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    return after, tuple(terms)


@mutant("types")
def returns_an_integer(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    return after, terms._replace(error=0)


@mutant("finite")
def divides_by_dt(memory, sample, constants, limits):
    rate = sample.measurement / sample.dt
    return honest(memory, sample._replace(rate=sample.rate + 0.0 * rate), constants, limits)


@mutant("finite")
def is_nan_where_it_saturates(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    if terms.unsaturated != terms.effort:
        return after._replace(effort=math.nan), terms._replace(effort=math.nan)
    return after, terms


@mutant("finite")
def compensates_by_a_sine(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    effort = terms.effort + sin(sample.measurement)
    return after._replace(effort=effort), terms._replace(effort=effort)


@mutant("finite")
def integrates_whatever_comes(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    error = sample.reference - sample.measurement
    return after._replace(integral=memory.integral + sample.dt * error), terms


@mutant("holds")
def lets_go_where_it_should_hold(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    return (
        (memory._replace(effort=0.0), terms._replace(effort=0.0)) if terms.held else (after, terms)
    )


@mutant("limits")
def ignores_the_limits(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    if terms.held:
        return after, terms
    return after._replace(effort=terms.unsaturated), terms._replace(effort=terms.unsaturated)


@mutant("limits")
def forgets_its_command(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    return (after, terms) if terms.held else (after._replace(effort=0.5 * terms.effort), terms)


@mutant("transfer")
def jumps_at_a_takeover(memory, sample, constants, limits):
    wide = limits._replace(u_min=-30.0, u_max=30.0)  # its own, not those given
    return honest(memory, sample, constants, wide)


def _from_nothing(memory: Memory, sample: Sample, before: Any, after: Any) -> Memory:
    return memory if before == after else Memory(-10.0, 0.0)


@mutant("reconfigure", reconfigure=_from_nothing)
def jumps_at_new_parameters(memory, sample, constants, limits):
    return honest(memory, sample, constants, limits)


def _forgets(memory: Memory, sample: Sample, before: Any, after: Any) -> Memory:
    return Memory()


@mutant("reconfigure", reconfigure=_forgets)
def forgets_at_new_parameters(memory, sample, constants, limits):
    return honest(memory, sample, constants, limits)


@mutant("time")
def adds_up_by_samples(memory, sample, constants, limits):
    return honest(memory, sample._replace(dt=0.005 if sample.dt > 0.0 else 0.0), constants, limits)


@mutant("quick")
def takes_its_time(memory, sample, constants, limits):
    total = 0.0
    for k in range(20_000):
        total += k * 0.0
    return honest(memory, sample._replace(rate=sample.rate + total), constants, limits)


@dataclass(frozen=True)
class Unbounded(ControllerConfig):
    """A parameter without bounds."""

    gain: float = parameter("gain", 40.0, "Torque per rad", unit="N m/rad")
    uses_rate = True
    constants = property(lambda self: (self.gain,))


@mutant("declared", config=Unbounded)
def has_no_bounds(memory, sample, constants, limits):
    return honest(memory, sample, constants, limits)


class Hiding(NamedTuple):
    """Terms that hide the record's reference."""

    reference: float
    unsaturated: float
    effort: float
    held: bool


@mutant("names", terms=Hiding, units={})
def hides_the_reference(memory, sample, constants, limits):
    after, terms = honest(memory, sample, constants, limits)
    return after, Hiding(*terms)
