"""Laws with one fault each, and the check that has to find it."""

import linecache
import math
import os
import random
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace
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


@dataclass(frozen=True)
class Unbounded(ControllerConfig):
    """A parameter without bounds."""

    gain: float = parameter("gain", 40.0, "Torque per rad", unit="N m/rad")
    uses_rate = True
    constants = property(lambda self: (self.gain,))


class Hiding(NamedTuple):
    """Terms that hide the record's reference."""

    reference: float
    unsaturated: float
    effort: float
    held: bool


def _from_nothing(memory: Memory, sample: Sample, before: Any, after: Any) -> Memory:
    return memory if before == after else Memory(-10.0, 0.0)


def _forgets(memory: Memory, sample: Sample, before: Any, after: Any) -> Memory:
    return Memory()


# Faults, each below the check that has to find it: what is done before the honest update, and behind it.
_TEXT = """\
source: counts_its_calls
    global calls
    calls += 1
source: remembers_in_a_list
    seen.append(sample.measurement)
source: remembers_in_itself
    remembers_in_itself.last = sample.measurement
source: remembers_in_a_default, kept=[]
source: reads_an_array
    sample = sample._replace(reference=offsets[0])
pure: remembers_in_an_object
    box.value += sample.dt
    sample = sample._replace(reference=sample.reference + box.value)
reset: survives_a_reset
    another_box.value += sample.dt
    sample = sample._replace(reference=sample.reference + another_box.value)
source: reads_the_clock
    constants = (0.0,) if time.monotonic() < 0.0 else constants
source: draws_at_random
    sample = sample._replace(reference=sample.reference + 0.0 * random.random())
source: reads_the_environment
    constants = (float(os.getenv("GAIN", "40")),)
source: reads_a_file
    with open(os.devnull) as file:
        file.read()
source: prints
    if sample.dt < 0.0:
        print(sample)
portable: takes_the_machines_sine
    angle = sample.reference if usable(sample.reference, 0.0, 1.0) else 0.0
    sample = sample._replace(reference=sample.reference - 0.0 * math.sin(angle))
portable: takes_numpys_exponential
    constants = (constants[0] * float(np.exp(0.0)),)
portable: takes_a_power
    constants = (constants[0] ** 1.5,)
portable: takes_a_square
    constants = (constants[0] ** 2,)
portable: takes_a_cube
    gain = constants[0]
    gain **= 3
    constants = (gain,)
portable: takes_a_power_of_a_constant
    constants = (constants[0] * 1.1**7,)
types: returns_other_terms
    HONEST
    terms = tuple(terms)
types: returns_an_integer
    HONEST
    terms = terms._replace(error=0)
finite: divides_by_dt
    sample = sample._replace(rate=sample.rate + 0.0 * (sample.measurement / sample.dt))
finite: is_nan_where_it_saturates
    HONEST
    if terms.unsaturated != terms.effort:
        after, terms = after._replace(effort=math.nan), terms._replace(effort=math.nan)
finite: compensates_by_a_sine
    HONEST
    effort = terms.effort + sin(sample.measurement)
    after, terms = after._replace(effort=effort), terms._replace(effort=effort)
finite: integrates_whatever_comes
    HONEST
    error = sample.reference - sample.measurement
    after = after._replace(integral=memory.integral + sample.dt * error)
holds: lets_go_where_it_should_hold
    HONEST
    if terms.held:
        after, terms = memory._replace(effort=0.0), terms._replace(effort=0.0)
limits: ignores_the_limits
    HONEST
    if not terms.held:
        effort = terms.unsaturated
        after, terms = after._replace(effort=effort), terms._replace(effort=effort)
limits: forgets_its_command
    HONEST
    if not terms.held:
        after = after._replace(effort=0.5 * terms.effort)
transfer: jumps_at_a_takeover
    limits = limits._replace(u_min=-30.0, u_max=30.0)  # its own, not those given
reconfigure: jumps_at_new_parameters
reconfigure: forgets_at_new_parameters
time: adds_up_by_samples
    sample = sample._replace(dt=0.005 if sample.dt > 0.0 else 0.0)
quick: takes_its_time
    total = 0.0
    for k in range(20_000):
        total += k * 0.0
    sample = sample._replace(rate=sample.rate + total)
declared: has_no_bounds
names: hides_the_reference
    HONEST
    terms = Hiding(*terms)
"""
_FIELDS: dict[str, dict[str, Any]] = {
    "jumps_at_new_parameters": {"reconfigure": _from_nothing},
    "forgets_at_new_parameters": {"reconfigure": _forgets},
    "has_no_bounds": {"config": Unbounded},
    "hides_the_reference": {"terms": Hiding, "units": {}},
}


def _faults() -> Iterator[tuple[str, tuple[str, Law]]]:
    names: dict[str, Any] = {m.__name__: m for m in (math, os, random, time, sin)}
    names |= {"calls": 0, "seen": [], "offsets": np.zeros(3)}
    names |= {name: SimpleNamespace(value=0.0) for name in ("box", "another_box")}
    names |= globals()
    update = "    after, terms = honest(memory, sample, constants, limits)\n"
    for check, name, more, body in re.findall(r"(\w+): (\w+)(.*)\n((?: .*\n)*)", _TEXT):
        before, _, behind = body.partition("    HONEST\n")
        head = f"def {name}(memory, sample, constants, limits{more}):\n"
        text = f"{head}{before}{update}{behind}    return after, terms\n"
        place = f"<{name}>"
        linecache.cache[place] = len(text), None, text.splitlines(keepends=True), place
        exec(compile(text, place, "exec"), names)
        fields = {"config": Config, "terms": Terms, "units": {"error": "rad"}}
        fields |= _FIELDS.get(name, {})
        yield name, (check, Law(name, "Faulty", update=names[name], memory=Memory(), **fields))


FAULTS = dict(_faults())
