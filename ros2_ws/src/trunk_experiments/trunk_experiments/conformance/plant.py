"""The conformance kit for plants: whether a plant meets the contract of all plants, and is mechanics.

What is asked of a plant's `accelerations`, in the coordinates q = (x, theta) with the forces f on them::

    q'' = a(q, q') + R f,   R = M^-1 symmetric and positive definite,   dE/dt <= f . q'

Of its picture, that it is whole: names, coordinates, numbers, and what moves in it.
"""

from __future__ import annotations

import copy
import os
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from ctypes import CDLL, c_double
from dataclasses import fields
from itertools import product
from math import inf, isfinite, isnan, nan, nextafter
from pathlib import Path
from random import Random
from struct import pack
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from trunk_control.pid import PidConfig
from trunk_core.c.types import UntranslatableError
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    build,
    declarations,
    values_of,
)
from trunk_core.parameters.parameter_files import Layer, Section
from trunk_core.parameters.shared import PLANT_NAME
from trunk_msgs_util.picture.frames import BASE, BODY, Picture, bar_of, poses, resolved
from trunk_runs.plan import RunPlan, make_plan
from trunk_sim.config import SimulatorConfig
from trunk_sim.plant import PLANTS, Plant, PlantConfig, PlantState, advance

from .kit import (
    Check,
    Finding,
    Kit,
    bounded,
    compiles,
    fastest_us,
    finite,
    name_of,
    own_parameters,
    recomputes,
    runs_in_lanes,
    untranslated,
)
from .purity import Contract, source_checks

CONTRACT = Contract(
    "plant", "trunk_sim.api", "compute everything from the state, the forces and the constants"
)
_STATES = 2000
_LARGE = 1e308
_EXTREMES = (0.0, nan, inf, -inf, _LARGE, -_LARGE)


class Given(NamedTuple):
    """What `accelerations` is given besides the constants."""

    state: PlantState
    first: float
    second: float

    def __str__(self) -> str:
        return f"{tuple(self.state)} with forces {self.first!r}, {self.second!r}"


def constants_of(plant: Plant) -> Any:
    """Return the constants of the default parameters."""
    return plant.config().constants


def roots_of(plant: Plant) -> list[Any]:
    """Return the plant's functions that runs call."""
    return [plant.accelerations, *([plant.held] if plant.held is not None else [])]


def random_states(position: float, rate: float, force: float, count: int) -> list[Given]:
    """Return states and forces of up to these magnitudes, the same in every process."""
    draw = Random(1).uniform
    return [
        Given(
            PlantState(
                draw(-position, position),
                draw(-position, position),
                draw(-rate, rate),
                draw(-rate, rate),
            ),
            draw(-force, force),
            draw(-force, force),
        )
        for _ in range(count)
    ]


def declares(plant: Plant) -> Iterator[Finding]:
    """Yield parameters without a description, bounds or a unit, and those that the simulator has itself."""
    yield from bounded(plant.config, PlantConfig)
    shared = {member.name for member in fields(PlantConfig)}
    taken = declarations(SimulatorConfig)
    simulators = {member.name for member in fields(SimulatorConfig)} - shared
    for member in fields(plant.config):
        name = member.metadata["declaration"].name
        if member.name in simulators or (member.name not in shared and name in taken):
            yield Finding(
                f"{name_of(plant.config)}.{member.name}",
                f"{name} has the name of a parameter of the simulator, which hides it",
                "rename field and parameter: plant.NAME",
            )


def _own(plant: Plant) -> dict[str, Declaration]:
    return own_parameters(plant.config, PlantConfig)


def types(plant: Plant) -> Iterator[Finding]:
    """Yield constants and results of other types than compiled code is made for."""
    constants = constants_of(plant)
    if not hasattr(constants, "_fields"):
        advice = "return a NamedTuple of floats"
        yield Finding(name_of(plant.config), f"has the constants {constants!r}", advice)
        return
    for name, value in constants._asdict().items():
        if value is None or type(value) is float:
            continue
        if type(value) is not tuple or any(type(number) is not float for number in value):
            yield Finding(
                name_of(type(constants)),
                f"{name} = {value!r} is {type(value).__name__}",
                "give a float, a tuple of floats or None: compiled code needs one type",
            )
    for function in roots_of(plant):
        result = function(plant.start, 0.5, -0.5, constants)
        kinds = [type(number) for number in result] if type(result) is tuple else []
        if kinds != [float, float]:
            yield Finding(
                name_of(function),
                f"returns {result!r}",
                "return (x_ddot, theta_ddot), two floats: 0.0, not 0",
            )
    if (
        plant.energy is not None
        and type(joule := plant.energy(plant.start, constants)) is not float
    ):
        yield Finding(name_of(plant.energy), f"returns {joule!r}", "return a float, J")


def pure(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where results depend on more than the arguments, or arguments are changed."""
    constants, where = constants_of(plant), name_of(plant.accelerations)
    before, given = copy.deepcopy(constants), random_states(3.0, 10.0, 10.0, 200)
    first = [repr(plant.accelerations(*each, constants)) for each in given]
    if repr(before) != repr(constants):
        yield Finding(where, "changes the constants that it is given", "leave them alone")
        return
    again = [repr(plant.accelerations(*each, constants)) for each in reversed(given)][::-1]
    for each, early, late in zip(given, first, again, strict=True):
        if early != late:
            problem = f"{each} gives {early} once and {late} later"
            yield Finding(where, problem, CONTRACT.keep)
            return


def finite_always(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where a usual state gives no finite accelerations, or any state raises."""
    constants, where = constants_of(plant), name_of(plant.accelerations)
    usual = random_states(10.0, 100.0, 1e3, _STATES)
    for given in usual:
        result = _result(plant, given, constants)
        if isinstance(result, str) or not finite(result):
            advice = "nothing that is divided by may become 0 in a state that the plant can reach"
            yield Finding(where, f"{given} {_gives(result)}", advice)
            return
    for numbers in product(_EXTREMES, repeat=6):
        given = Given(PlantState(*numbers[:4]), *numbers[4:])
        result = _result(plant, given, constants)
        if isinstance(result, str):
            advice = "let NaN through: test with <, >, and divide by nothing that may be 0"
            yield Finding(where, f"{given} {result}", advice)
            return
    for name, declared in _own(plant).items():
        for bound in _bounds(declared):
            try:
                config = build(plant.config, {name: bound})
            except ParameterError:
                continue
            result = _result(plant, usual[0], config.constants)
            if isinstance(result, str):
                advice = f"give {name} a minimum that keeps what is divided by away from 0"
                yield Finding(where, f"{name} = {bound!r} {result}", advice)


def _result(plant: Plant, given: Given, constants: Any) -> tuple[float, float] | str:
    """Return the accelerations, or what they raise."""
    try:
        return plant.accelerations(*given, constants)
    except Exception as error:
        return f"raises {type(error).__name__}: {error}"


def _gives(result: object) -> str:
    return result if isinstance(result, str) else f"gives {result!r}"


def _bounds(declared: Declaration) -> Iterator[float]:
    """Yield the least and the greatest value of a number."""
    if declared.kind != "double":
        return
    if declared.minimum is not None:
        yield float(declared.minimum)
    if declared.above is not None:
        yield nextafter(float(declared.above), inf)
    if declared.maximum is not None:
        yield float(declared.maximum)


def responses(plant: Plant, state: PlantState, constants: Any) -> np.ndarray[Any, Any]:
    """Return R, the accelerations per unit of force [2, 2]: the columns are those of the two forces."""
    force = 1e3

    def response(first: float, second: float) -> list[float]:
        pushed = plant.accelerations(state, first, second, constants)
        pulled = plant.accelerations(state, -first, -second, constants)
        return [(a - b) / (2.0 * force) for a, b in zip(pushed, pulled, strict=True)]

    return np.array([response(force, 0.0), response(0.0, force)]).T


def takes_forces(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where accelerations are not ``a + R f``, R symmetric and positive definite."""
    constants, where = constants_of(plant), name_of(plant.accelerations)
    for given in random_states(10.0, 1.0, 1e3, 200):
        state, forces = given.state, np.array(given[1:])
        free = np.array(plant.accelerations(state, 0.0, 0.0, constants))
        r = responses(plant, state, constants)
        at = f"at {tuple(state)}"
        scale = np.abs(free) + np.abs(r) @ np.abs(forces)
        off = np.array(plant.accelerations(*given, constants)) - free - r @ forces
        if not np.all(np.abs(off) <= 1e-9 * scale.max()):
            problem = f"{at} the accelerations are not affine in the forces"
            advice = "multiply and divide forces by what depends on the state alone"
            yield Finding(where, problem, advice)
            return
        matrix = f"{at} a unit of each force gives {r.tolist()}"
        if abs(r[0, 1] - r[1, 0]) > 1e-9 * np.abs(r).max() + 1e-15 * np.abs(free).max():
            yield Finding(
                where,
                f"{matrix}, which is not symmetric",
                "take the forces on the coordinates themselves (work is F x + tau theta), and look for a "
                "wrong sign or a missing cosine",
            )
            return
        if not (r[0, 0] > 0.0 and r[1, 1] > 0.0 and r[0, 0] * r[1, 1] > r[0, 1] * r[1, 0]):
            yield Finding(
                where,
                f"{matrix}, which is not positive definite",
                "a force accelerates its own coordinate forwards: look for a wrong sign",
            )
            return


def rests(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where the plant does not stay at ``rest`` without a command."""
    constants, rest = plant.level(constants_of(plant)), plant.rest
    result = plant.accelerations(rest, 0.0, 0.0, constants)
    if any(rest[2:]) or not all(abs(number) <= 1e-9 for number in result):
        yield Finding(
            name_of(plant.accelerations),
            f"at rest, {tuple(rest)}, the accelerations are {result!r}",
            "give Plant(rest=...) an equilibrium, with rates of 0; level= the constants that it has there",
        )


def raises_the_angle(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where a positive command does not raise the held angle, as every law here expects."""
    constants, rest = plant.level(constants_of(plant)), plant.rest
    gain = float(responses(plant, rest, constants)[1, plant.drive])
    if not gain > 0.0:
        yield Finding(
            name_of(plant.accelerations),
            f"at rest a positive command accelerates the {plant.coordinates[1].joint} by {gain:g} rad/s^2 "
            f"per {plant.driven.effort_unit}",
            "turn the sense of the angle (or of the force), so that it is positive: gains here are not "
            "negative",
        )


_STEP = 1e-5  # s, of the differences of the energy


def keeps_energy(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where energy comes from elsewhere than the forces; note where some is lost.

    The usual constants, and those with what is usually 0, such as friction, switched on.
    """
    energy, where = plant.energy, name_of(plant.accelerations)
    if energy is None:
        problem = "has no energy, by which wrong equations would be found"
        yield Finding(where, problem, "give Plant(energy=...)", note=True)
        return
    constants = constants_of(plant)
    gained, lost = _unexplained(plant, energy, constants)
    used = constants
    if not gained:
        used = _switched_on(plant)
        gained, _ = _unexplained(plant, energy, used)
    if gained:
        advice = "look for a wrong sign or factor: energy() and accelerations() disagree"
        yield Finding(where, f"{gained}, with {used}", advice)
    elif lost:
        advice = "if that is friction, it is as meant; if not, look for a wrong sign or factor"
        yield Finding(where, lost, advice, note=True)
    else:
        yield from _drifts(plant, energy, constants)


def _switched_on(plant: Plant) -> Any:
    """Return the constants with each number that is 0 by default as near to 1 as it may be."""
    values = {
        name: min(1.0, inf if declared.maximum is None else float(declared.maximum))
        for name, declared in _own(plant).items()
        if declared.kind == "double" and declared.default == 0.0
    }
    try:
        return build(plant.config, values).constants
    except ParameterError:
        return constants_of(plant)


def _unexplained(
    plant: Plant, energy: Callable[[PlantState, Any], float], constants: Any
) -> tuple[str, str]:
    """Return where energy is gained without a force, and where it is lost; empty if nowhere.

    Gained, too, is what changes with the sense of the motion: friction loses as much either way.
    """
    lost = ""
    for given in random_states(3.0, 3.0, 1.0, 200):
        state, weight = given.state, 10.0 / np.diag(responses(plant, given.state, constants))
        forces = given.first * float(weight[0]), given.second * float(weight[1])
        back = state._replace(x_dot=-state.x_dot, theta_dot=-state.theta_dot)
        excess, allowed, said = _excess(plant, energy, state, forces, constants)
        returned, allowed_back, _ = _excess(plant, energy, back, forces, constants)
        if not abs(excess - returned) <= allowed + allowed_back:
            turned = f"{excess:.9g} W besides, and {returned:.9g} W with both rates turned round"
            return f"{said}: {turned}, where friction is the same", ""
        if not abs(excess) <= allowed:
            if not excess <= 0.0:
                return said, ""
            lost = said
    return "", lost


def _excess(
    plant: Plant,
    energy: Callable[[PlantState, Any], float],
    state: PlantState,
    forces: tuple[float, float],
    constants: Any,
) -> tuple[float, float, str]:
    """Return by how much more the energy changes than by the forces, what rounding allows [W], and a text."""
    x_ddot, theta_ddot = plant.accelerations(state, *forces, constants)
    moved = (state.x_dot, state.theta_dot, 0.0, 0.0), (0.0, 0.0, x_ddot, theta_ddot)
    slopes = [_slope(energy, state, along, constants) for along in moved]
    powers = forces[0] * state.x_dot, forces[1] * state.theta_dot
    scale = sum(map(abs, (*slopes, *powers)))
    said = (
        f"{Given(state, *forces)}: energy changes by {sum(slopes):.9g} W, "
        f"the forces give {sum(powers):.9g} W"
    )
    allowed = 1e-6 * scale + 1e-9 * abs(energy(state, constants))
    return sum(slopes) - sum(powers), allowed, said


def _slope(
    energy: Callable[[PlantState, Any], float],
    state: PlantState,
    along: Sequence[float],
    constants: Any,
) -> float:
    ahead, behind = (
        PlantState(*(q + sign * _STEP * slope for q, slope in zip(state, along, strict=True)))
        for sign in (1.0, -1.0)
    )
    return (energy(ahead, constants) - energy(behind, constants)) / (2.0 * _STEP)


def _drifts(
    plant: Plant, energy: Callable[[PlantState, Any], float], constants: Any
) -> Iterator[Finding]:
    """Note where integrating a free motion changes the energy: the usual step is too long for this plant."""
    h, seconds = 1e-3, 2.0
    state = plant.start
    begun = energy(state, constants)
    state = advance(state, 0.0, 0.0, seconds, round(seconds / h), constants, plant.accelerations)
    drift = abs(energy(state, constants) - begun) / max(
        abs(begun), abs(energy(plant.rest, constants)), 1e-300
    )
    if not drift <= 1e-8:
        yield Finding(
            name_of(plant.accelerations),
            f"in {seconds:g} s without forces at steps of 1 ms it drifts by {drift:.2g} of its value",
            "integrate it in shorter steps: simulator.substeps in its scenario",
            note=True,
        )


def linearises(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where the plant has no slopes at rest; note a command that does not reach all of it."""
    from trunk_studies.tuning.linear import linearised
    from trunk_studies.tuning.methods import controllable

    where = name_of(plant.accelerations)
    fixed = plant.accelerations, plant.level(constants_of(plant)), plant.rest, plant.drive
    a, b = linearised(*fixed)
    coarse, _ = linearised(*fixed, step=1e-4)
    off = np.abs(a - coarse)
    if not off.max() <= 1e-5 * np.abs(a).max():
        row, column = np.unravel_index(int(off.argmax()), off.shape)
        over, of = PlantState._fields[column], ("x_ddot", "theta_ddot")[int(row) - 2]
        yield Finding(
            where,
            f"at rest the slope of {of} over {over} depends on the step of its difference",
            "leave out what has no slope there: Coulomb friction belongs to actuator.coulomb_friction",
        )
    elif not controllable(a, b):
        problem = "at rest the command does not control both coordinates"
        advice = "to know: no gains of state_feedback hold both"
        yield Finding(where, problem, advice, note=True)


def is_drawn(plant: Plant) -> Iterator[Finding]:
    """Yield what is wrong with the picture: names, coordinates, numbers; parts that do not move."""
    where = f"{plant.name}: Plant.picture"
    problems = _misnamed(plant)
    for problem, advice in problems or _misplaced(plant):
        yield Finding(where, problem, advice)


def _misnamed(plant: Plant) -> list[tuple[str, str]]:
    """Return problems of a picture's names, each with advice."""
    frames, visuals, _ = plant.picture
    known, problems = [""], []
    for frame in frames:
        called = f"frame {frame.name!r}"
        if frame.name in known:
            problems.append((f"{called} has no name of its own", "give each frame another name"))
        if frame.on not in known:
            problems.append((f"{called} is on {frame.on!r}", "list a frame after the one it is on"))
        if frame.slides != -1 and frame.turns != -1:
            advice = "give two frames, the one that turns on the one that slides"
            problems.append((f"{called} slides and turns", advice))
        for verb, unit, place in (("slides", "m", frame.slides), ("turns", "rad", frame.turns)):
            if place not in (-1, 0, 1):
                problems.append((f"{called}: {verb}={place!r}", "give a coordinate, 0 or 1"))
            elif place >= 0 and plant.coordinates[place].unit != unit:
                of = f"{verb}={place}, a coordinate in {plant.coordinates[place].unit}"
                problems.append((f"{called}: {of}", f"what {verb} has a coordinate in {unit}"))
        known.append(frame.name)
    names = [visual.name for visual in visuals]
    for visual in visuals:
        called = f"visual {visual.name!r}"
        if not visual.name or names.count(visual.name) > 1:
            problems.append((f"{called} has no name of its own", "give each visual another name"))
        if visual.frame not in known:
            problems.append(
                (f"{called} is in the frame {visual.frame!r}", "name one of the frames")
            )
        if visual.role not in (BASE, BODY):
            problems.append((f"{called} has the role {visual.role!r}", "give BASE or BODY"))
    for name in (*known, *names):
        if "." in name:
            problems.append((f"{name!r} has a dot, as parameters have", "give another name"))
    if bar_of(plant.picture, 1) is None:
        advice = "give a Visual of two points in a frame with turns=1"
        problems.append(("no bar turns with the held angle", advice))
    return list(dict.fromkeys(problems))


def _misplaced(plant: Plant) -> Iterator[tuple[str, str]]:
    """Yield problems of a picture's numbers, each with advice."""
    values = values_of(plant.config())
    try:
        picture = resolved(plant.picture, values)
    except KeyError as error:
        name = error.args[0]
        own = own_parameters(plant.config, PlantConfig)
        numbers = [name for name in own if isinstance(values[name], float)]
        yield f"no parameter is called {name!r}", f"give a number or one of {', '.join(numbers)}"
        return
    for visual in picture.visuals:
        sizes = [visual.size, *([] if visual.page is None else [visual.page])]
        numbers = [*sizes, *(number for spot in visual.points for number in spot)]
        if not visual.points or not all(map(_is_number, numbers)) or min(sizes) < 0.0:
            problem = (
                f"visual {visual.name!r} has the points {visual.points} and the size {sizes[0]!r}"
            )
            yield problem, "give one or two numbers in m for each, or names of parameters"
            return
    for frame in picture.frames:
        if not all(map(_is_number, (*frame.at, frame.sense))):
            problem = f"frame {frame.name!r} is at {frame.at}, sense {frame.sense!r}"
            yield problem, "give numbers, or names of parameters"
            return
    for bar in dict.fromkeys(filter(None, (bar_of(picture, plant.drive), bar_of(picture, 1)))):
        if not any(bar.points[-1]):
            advice = "give last the point that moves most"
            yield f"the bar {bar.name!r} ends at its frame's origin, where it turns", advice
            return
    for place, coordinate in enumerate(plant.coordinates):
        moved = [0.3, 0.3]
        moved[place] += 0.1
        if _spots(picture, (0.3, 0.3)) == _spots(picture, (moved[0], moved[1])):
            verb = "slides" if coordinate.unit == "m" else "turns"
            advice = f"draw something in a frame with {verb}={place}"
            yield f"nothing moves with the {coordinate.joint}", advice


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and isfinite(value)


def _spots(picture: Picture, position: tuple[float, float]) -> list[tuple[float, float]]:
    """Return where all points are in the world."""
    placed = poses(picture, position)
    return [placed[v.frame].point(spot) for v in picture.visuals for spot in v.points]


SLOWEST_US = 20.0


def quick(plant: Plant) -> Iterator[Finding]:
    """Yield if the quickest of many evaluations takes too much of a step: there are thousands a second."""
    constants = constants_of(plant)
    given = random_states(3.0, 10.0, 10.0, 50)
    took = fastest_us(lambda each: plant.accelerations(each[0], each[1], each[2], constants), given)
    if took > SLOWEST_US:
        yield Finding(
            name_of(plant.accelerations),
            f"takes {took:.0f} us at best, {SLOWEST_US:.0f} us are allowed",
            "move what does not depend on the state into the configuration's constants",
        )


def short_plan(plant: Plant) -> RunPlan:
    """Return a run of 2 s under a PD that holds the angle, from where the plant starts.

    Its gains place the poles of ``theta'' = a theta + b u`` at -5 1/s, as far as they may be so large.
    """
    from trunk_studies.tuning.linear import linearised

    everywhere = {"duration": 2.0, "update_rate": 500.0, "substeps": 2}
    fixed = plant.accelerations, plant.level(constants_of(plant)), plant.rest, plant.drive
    a, b = linearised(*fixed)
    gain, slope = float(b[3]), float(a[3, 1])
    sections = [Section("/**", everywhere), Section("simulator", {PLANT_NAME: plant.name})]
    if gain > 0.0:
        wanted = {"gains.p": max(slope + 25.0, 0.0) / gain, "gains.i": 0.0, "gains.d": 10.0 / gain}
        declared = declarations(PidConfig)
        most = {name: float(declared[name].maximum or inf) for name in wanted}
        gains = {name: min(value, most[name]) for name, value in wanted.items()}
        sections.append(Section("pid", gains))
    return make_plan(Layer("plant check", sections), "pid")


def compiled(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where compiled code differs from CPython; note what numba refuses."""
    return compiles(short_plan(plant), name_of(plant.accelerations), lambda: "more slowly")


def in_lanes(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where a run in a lane has other bits than alone; note one that is in no lane."""
    return runs_in_lanes(short_plan(plant), name_of(plant.accelerations))


def recomputed(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where a recorded run differs from its recomputation."""
    return recomputes(short_plan(plant), name_of(plant.accelerations), CONTRACT.keep)


def exports(plant: Plant) -> Iterator[Finding]:
    """Yield a finding where its C gives other bits; note what keeps it from C, or from the comparison."""
    constants, where = constants_of(plant), name_of(plant.accelerations)
    try:
        text = c_text(plant, constants)
    except UntranslatableError as error:
        yield untranslated(error, "trunk lab and --device cuda refuse it")
        return
    given = random_states(10.0, 100.0, 1e3, _STATES)
    try:
        results = _by_c(text, given)
    except OSError as error:
        problem = f"its C was not compared with CPython: {error}"
        yield Finding(where, problem, "install gcc or clang, or set CC", note=True)
        return
    for each, numbers in zip(given, results, strict=True):
        expected = plant.accelerations(*each, constants)
        if not all(map(_same_bits, numbers, expected)):
            problem = f"{each} gives {numbers!r} in C, {expected!r} in CPython"
            yield Finding(where, problem, "compare with <, >, if; not with min, max")
            return


def c_text(plant: Plant, constants: Any) -> str:
    """Return the accelerations in C: ``evaluate(in, out, n)`` of n rows of 6 and 2 numbers.

    Raises UntranslatableError.
    """
    from trunk_core.c.translate import Program
    from trunk_core.c.types import REAL, at_run_time, type_of

    program = Program()
    state, kind = type_of(plant.start), type_of(constants)
    function = program.function(plant.accelerations, [state, REAL, REAL, kind])
    fields = [place for place, _ in program.places(state, "state")]
    first, second = (place for place, _ in program.places(function.result, "result"))
    arguments = ["&state", "row[4]", "row[5]"]
    held = ""
    if at_run_time(kind):
        held = f"static const {program.c_type(kind)} held = {program.initial(constants, kind)};"
        arguments.append("&held")
    evaluate = f"""
{held}
void evaluate(const double *row, double *out, int n)
{{
    for (int i = 0; i < n; i++, row += 6, out += 2) {{
        {program.c_type(state)} state;
        {" ".join(f"{place} = row[{k}];" for k, place in enumerate(fields))}
        const {program.c_type(function.result)} result = {function.name}({", ".join(arguments)});
        out[0] = {first};
        out[1] = {second};
    }}
}}
"""
    return program.library(evaluate) + evaluate


def _by_c(text: str, given: Sequence[Given]) -> list[tuple[float, float]]:
    """Return the accelerations of compiled C. Raises OSError where it is not compiled."""
    compiler = shlex.split(os.environ.get("CC") or ("gcc" if shutil.which("gcc") else "clang"))
    rows = [number for each in given for number in (*each.state, *each[1:])]
    inputs, outputs = (c_double * len(rows))(*rows), (c_double * (2 * len(given)))()
    with TemporaryDirectory(prefix="trunk-check-") as folder:
        source, library = Path(folder, "plant.c"), Path(folder, "plant.so")
        source.write_text(text)
        flags = ["-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared"]
        command = [*compiler, *flags, str(source), "-o", str(library)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            said = "; ".join(done.stderr.splitlines()[:1])
            raise OSError(f"{shlex.join(compiler)} ended with {done.returncode}: {said}")
        CDLL(str(library)).evaluate(inputs, outputs, len(given))
    return list(zip(outputs[::2], outputs[1::2], strict=True))


def _same_bits(a: float, b: float) -> bool:
    return (isnan(a) and isnan(b)) or pack("<d", a) == pack("<d", b)


CHECKS: tuple[Check[Plant], ...] = (
    Check("declared", "its parameters have descriptions, bounds and units", declares),
    Check("types", "its functions take and return floats", types),
    *source_checks(roots_of, CONTRACT),
    Check("pure", "the same inputs give the same outputs", pure),
    Check("finite", "finite where it may be, and never raises", finite_always),
    Check("forces", "forces accelerate as a mass matrix has it", takes_forces),
    Check("rest", "it stays at rest without a command", rests),
    Check("sign", "a positive command raises the held angle", raises_the_angle),
    Check("energy", "its energy changes by forces and friction alone", keeps_energy),
    Check("linear", "it has slopes at rest", linearises),
    Check("quick", f"an evaluation takes less than {SLOWEST_US:.0f} us", quick),
    Check("picture", "its picture is whole, and moves with both coordinates", is_drawn),
    Check("compiled", "compiled code gives the same bits", compiled),
    Check("lanes", "its runs go side by side in lanes, with the same bits", in_lanes),
    Check("exportable", "it can be written as C with the same bits", exports),
    Check("replay", "a recording of it verifies", recomputed),
)
KIT = Kit("plant", PLANTS.named, lambda plant: plant.accelerations, CHECKS)
conformance = KIT.conformance
