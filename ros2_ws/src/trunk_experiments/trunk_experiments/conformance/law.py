"""The conformance kit for laws: whether a law meets the contract of all laws."""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator
from itertools import product
from math import inf, nan
from pathlib import Path
from time import process_time
from typing import Any

from trunk_control.controller import Controller
from trunk_control.law import (
    ControllerConfig,
    Hip,
    Law,
    Limits,
    Sample,
    from_scratch,
    limited,
    unchanged,
)
from trunk_control.laws import law_named
from trunk_core.c.types import UntranslatableError
from trunk_core.elementary import LARGEST_ANGLE, cos, sin, sincos
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    build,
    declarations,
    listed,
    table_of,
    values_of,
)
from trunk_core.parameters.parameter_files import ParameterFileError, read
from trunk_runs.plan import RunPlan, make_plan
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.batch.lanes import without_row

from .kit import (
    ALONE,
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
from .purity import Contract, functions_from, source_checks


class Driven:
    """A law driven sample by sample, its default configuration within given limits."""

    def __init__(self, law: Law, limit: float = 50.0, **changes: Any) -> None:
        self.law = law
        self.config = law.config(u_clamp_min=-limit, u_clamp_max=limit, **changes)
        self.limits: Limits = self.config.limits
        self.constants = self.config.constants
        self.memory: Any = law.memory

    def update(self, sample: Sample) -> Any:
        """Return the terms of an update."""
        self.memory, terms = self.law.update(self.memory, sample, self.constants, self.limits)
        return terms

    def run(self, samples: list[Sample]) -> list[Any]:
        """Return the terms of updates with these samples."""
        return [self.update(sample) for sample in samples]


def given(sample: Sample) -> str:
    """Return a sample as a phrase."""
    return (
        f"reference {sample.reference!r}, measurement {sample.measurement!r}, rate {sample.rate!r}, "
        f"dt {sample.dt!r}"
    )


DT = 0.005
STILL = Hip(0.0, 0.0)
_LARGE = 1e308
_EXTREMES = (0.0, -50.0, nan, inf, -inf, _LARGE, -_LARGE, 5e-324)


def swinging(duration: float, amplitude: float = 0.3) -> list[Sample]:
    """Return smooth samples of a trunk that swings at 1 Hz around a reference of 0.1 rad."""
    turn = 6.283185307179586
    samples = []
    for k in range(round(duration / DT)):
        angle = turn * k * DT
        hip = Hip(0.2 * k * DT, 0.2)
        samples.append(Sample(0.1, amplitude * sin(angle), amplitude * turn * cos(angle), DT, hip))
    return samples


def steady(count: int, dt: float = DT) -> list[Sample]:
    """Return samples of a trunk at rest, 0.2 rad from its reference."""
    return [Sample(0.2, 0.0, 0.0, dt, STILL)] * count


def unusable() -> list[Sample]:
    """Return samples with at least one input that is not finite, or whose time does not advance."""
    samples = [
        Sample(r, y, w, dt, STILL)
        for r, y, w, dt in product((0.0, nan, inf), (0.1, nan, -inf), (0.0, nan, inf), (DT, 0.0))
    ]
    samples += [Sample(0.0, 0.1, 0.0, -DT, STILL), Sample(0.0, 0.1, 0.0, nan, STILL)]
    usable = Sample(0.0, 0.1, 0.0, DT, STILL)
    return [sample for sample in samples if sample != usable]


def extreme() -> list[Sample]:
    """Return samples of extreme numbers: some overflow in any law."""
    return [
        Sample(r, y, w, dt, STILL)
        for r, y, w, dt in product(_EXTREMES, _EXTREMES, _EXTREMES, (DT, 1e308, 5e-324, 0.0))
    ]


def named(law: Law) -> Iterator[Finding]:
    """Yield names of terms that hide what every record has, and terms without a unit."""
    for name in law.terms._fields:
        if name in ("reference", "measurement"):
            yield Finding(
                name_of(law.terms),
                f"has a field {name!r}, which every record already has",
                "leave it out or rename it",
            )
    missing = [name for name in law.terms._fields[:-3] if name not in law.units]
    if missing:
        yield Finding(
            name_of(law.terms),
            f"{', '.join(missing)}: without a unit",
            "give it in Law(units=...), an empty one for a ratio",
            note=True,
        )


def in_default_file(law: Law) -> Iterator[Finding]:
    """Yield differences in parameters between the law and the package's ``config/default.yaml``."""
    package = sys.modules[law.config.__module__.partition(".")[0]]
    # The one in the sources, to which colcon's build folder may link.
    path = Path(package.__file__ or "").resolve().parent / "config" / "default.yaml"
    if not path.is_file():
        return
    try:
        layer = read(path)
    except ParameterFileError as error:
        yield Finding(str(path), str(error), "correct the file, or delete it")
        return
    sections = [section for section in layer.sections if section.last_token == law.name]
    if not sections:
        return
    given = {name: value for section in sections for name, value in section.values.items()}
    known = listed(law.config)
    covered = {table_of(name, known) or name for name in given}
    for name in given:
        if name not in known and not table_of(name, known):
            advice = f"rename or remove it: the law has {', '.join(_own(law)) or 'none of its own'}"
            yield Finding(str(path), f"sets {name}, which the law does not declare", advice)
    for name, declared in _own(law).items():
        where = f"{name}, default {declared.default}"
        if name not in covered:
            yield Finding(str(path), f"lacks {where}", "add it, or delete the file")
        elif isinstance(given.get(name), int | float) and given[name] != declared.default:
            problem = f"has {name}: {given[name]}, the law's default is {declared.default}"
            yield Finding(str(path), problem, "write the law's value, if that is meant", note=True)


def _own(law: Law) -> dict[str, Declaration]:
    return own_parameters(law.config, ControllerConfig)


def declares(law: Law) -> Iterator[Finding]:
    """Yield parameters without a description, bounds or a unit."""
    return bounded(law.config, ControllerConfig)


CONTRACT = Contract("law", "trunk_control.api", "keep everything in the memory that update returns")


def roots_of(law: Law) -> list[object]:
    """Return the law's functions."""
    roots: list[object] = [law.update]
    roots += [
        function
        for function in (law.transfer, law.reconfigure)
        if function not in (from_scratch, unchanged)
    ]
    if law.lookup is not None:
        roots += [law.lookup.inputs, law.lookup.cell, law.lookup.near]
    return roots


SLOWEST_US = 200.0
_LIMIT = 5.0


def types(law: Law) -> Iterator[Finding]:
    """Yield a finding where an update returns other types than the law declares."""
    driven, update = Driven(law), name_of(law.update)
    sample = swinging(DT)[0]
    returned = law.update(driven.memory, sample, driven.constants, driven.limits)
    if not (type(returned) is tuple and len(returned) == 2):
        yield Finding(update, f"returns {returned!r}", "return (memory, terms)")
        return
    terms = law.terms(*(False if field == "held" else 0.0 for field in law.terms._fields))
    for part, record, declared in zip(
        ("memory", "terms"), returned, (law.memory, terms), strict=True
    ):
        if type(record) is not type(declared):
            yield Finding(
                update,
                f"returns a {type(record).__name__} as {part}",
                f"return the {type(declared).__name__} that the law declares",
            )
            continue
        for problem, kind in _mistyped(record, declared, part):
            advice = f"it is declared as {kind}; compiled code needs one type"
            yield Finding(update, problem, advice)


def _mistyped(value: Any, declared: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield each leaf of a record that has another type than declared, in words, and the declared type."""
    kind = type(declared)
    if type(value) is not kind:
        yield f"{name} = {value!r} is {type(value).__name__}", kind.__name__
    elif isinstance(declared, tuple) and len(value) != len(declared):
        yield f"{name} = {value!r} has {len(value)} parts", f"a {kind.__name__} of {len(declared)}"
    elif isinstance(declared, tuple):
        for field, part, wanted in zip(
            getattr(declared, "_fields", range(len(declared))), value, declared, strict=True
        ):
            yield from _mistyped(part, wanted, f"{name}.{field}")


def pure(law: Law) -> Iterator[Finding]:
    """Yield a finding where outputs depend on more than the inputs, or inputs are changed."""
    update, samples = name_of(law.update), swinging(1.0)
    driven = Driven(law)
    before = copy.deepcopy((driven.memory, driven.constants))
    first = driven.run(samples)
    if repr(before) != repr((law.memory, driven.constants)):
        yield Finding(
            update, "changes the memory or the constants that it is given", "return new ones"
        )
    Driven(law).run(swinging(0.7, amplitude=1.1))
    for k, (terms, repeated) in enumerate(zip(first, Driven(law).run(samples), strict=True)):
        if repr(terms) != repr(repeated):
            yield Finding(
                update,
                f"sample {k} of the same series gives {terms!r} once and {repeated!r} later",
                "take everything from memory, sample, constants and limits",
            )
            return


def finite_always(law: Law) -> Iterator[Finding]:
    """Yield a finding where an input makes the command or the memory not finite, or raises."""
    update, hold = name_of(law.update), "return the memory as it was, and held = True"
    if sincos in functions_from(roots_of(law)):
        hold += f"; sin and cos of trunk_control.api are NaN beyond +-{LARGEST_ANGLE:.0f} rad"
    for sample in extreme():
        driven = Driven(law)
        driven.run(swinging(5 * DT))
        try:
            terms = driven.update(sample)
        except Exception as error:
            yield Finding(
                update,
                f"{given(sample)} raises {type(error).__name__}: {error}",
                "test `usable` first, and hold",
            )
            return
        if not (finite(driven.memory) and finite((terms.effort,))):
            yield Finding(
                update,
                f"{given(sample)} gives effort {terms.effort!r}, memory {tuple(driven.memory)!r}",
                f"hold where a result is not finite: {hold}",
            )
            return


def holds(law: Law) -> Iterator[Finding]:
    """Yield a finding where a sample that is not usable changes the memory or the command."""
    update = name_of(law.update)
    for sample in unusable():
        driven = Driven(law)
        driven.run(swinging(5 * DT))
        before = driven.memory
        try:
            terms = driven.update(sample)
        except Exception:
            return  # `finite_always` reports it
        wanted = limited(before.effort, driven.limits)
        if not (terms.held and repr(driven.memory) == repr(before) and terms.effort == wanted):
            if not driven.config.uses_rate and finite(sample[:2]) and sample.dt > 0.0:
                continue  # a law that ignores the rate may go on
            yield Finding(
                update,
                f"{given(sample)} gives held = {terms.held}, effort {terms.effort!r}, and "
                f"{'the same' if repr(driven.memory) == repr(before) else 'another'} memory",
                f"return the memory as it was, the command {wanted!r} and held = True",
            )
            return


def within_limits(law: Law) -> Iterator[Finding]:
    """Yield a finding where a command is not the unlimited one, limited, or the memory lacks it."""
    update = name_of(law.update)
    for limit in (_LIMIT, 0.01, 1e9):
        driven = Driven(law, limit)
        for sample in swinging(1.0, amplitude=1.5):
            terms = driven.update(sample)
            if not -limit <= terms.effort <= limit:
                yield Finding(
                    update,
                    f"{given(sample)} within +-{limit:g} N m gives effort {terms.effort!r}",
                    "effort = limited(unsaturated, limits)",
                )
                return
            if not terms.held and (
                terms.effort != limited(terms.unsaturated, driven.limits)
                or driven.memory.effort != terms.effort
            ):
                yield Finding(
                    update,
                    f"{given(sample)} gives unsaturated {terms.unsaturated!r}, effort {terms.effort!r}, "
                    f"memory.effort {driven.memory.effort!r}",
                    "effort = limited(unsaturated, limits), and memory.effort = effort",
                )
                return


def quick(law: Law) -> Iterator[Finding]:
    """Yield if the quickest of many updates takes too much of a control period."""
    took = fastest_us(Driven(law).update, swinging(0.2))
    if took > SLOWEST_US:
        yield Finding(
            name_of(law.update),
            f"an update takes {took:.0f} us at best, {SLOWEST_US:.0f} us is allowed",
            "move what does not depend on the sample into the configuration's constants",
        )


def reset(law: Law) -> Iterator[Finding]:
    """Yield a finding where a controller behaves differently after a reset than a new one."""
    controllers = [Controller(law.config(), law) for _ in range(2)]
    for k, sample in enumerate(swinging(0.5, amplitude=0.9)):
        controllers[0].update(5_000_000 * k, sample.measurement, sample.rate)
    controllers[0].forget()
    efforts: list[list[Any]] = [
        [
            controller.update(5_000_000 * k, s.measurement, s.rate).effort
            for k, s in enumerate(swinging(0.2))
        ]
        for controller in controllers
    ]
    if efforts[0] != efforts[1]:
        k = next(k for k, (a, b) in enumerate(zip(*efforts, strict=True)) if a != b)
        yield Finding(
            name_of(law.update),
            f"update {k} after a reset gives {efforts[0][k]!r}, a new controller's {efforts[1][k]!r}",
            "keep nothing outside the memory",
        )


def transfers(law: Law) -> Iterator[Finding]:
    """Yield a finding where a bumpless transfer moves the command by more than one step."""
    for acting in (-12.5, 0.0, 20.0):
        controller = Controller(law.config(u_clamp_min=-30.0, u_clamp_max=30.0), law)
        controller.deactivate()
        controller.update(5_000_000, 0.05, 0.1)
        controller.activate()
        step, last = controller.config.handover_step, acting
        for k in range(2, 6):
            answer = controller.update(
                5_000_000 * k, 0.05 + 0.001 * k, 0.1, effort=acting if k == 2 else last
            )
            if abs(answer.effort - last) > step * (1.0 + 1e-12):
                yield Finding(
                    name_of(law.transfer),
                    f"from {last:g} N m its command is {answer.effort!r} N m, one step may be {step:g} N m",
                    "keep to the limits given, which are narrowed during a bumpless transfer",
                )
                return
            if not controller.state.transfer.transferring:
                break
            last = answer.effort


def reconfigures(law: Law) -> Iterator[Finding]:
    """Yield a finding where new parameters move the command more than with the memory left alone."""
    driven = Driven(law, 1e9)
    driven.run(steady(200))
    before = driven.memory.effort
    where = name_of(law.reconfigure)
    same = law.reconfigure(driven.memory, steady(1)[0], driven.constants, driven.constants)
    if repr(same) != repr(driven.memory):
        yield Finding(
            where,
            f"unchanged constants change the memory from {driven.memory!r} to {same!r}",
            "return the memory",
        )
        return
    sample = Sample(*steady(1)[0][:3], 1e-9, steady(1)[0].hip)
    for name, value in _tunable(law).items():
        try:
            changed = build(law.config, {**values_of(driven.config), name: 1.25 * value})
        except ParameterError:
            continue

        def jump(memory: Any, constants: Any = changed.constants) -> float:
            _, terms = law.update(memory, sample, constants, driven.limits)
            return float(abs(terms.effort - before))

        left = jump(driven.memory)
        taken = jump(
            law.reconfigure(driven.memory, steady(1)[0], driven.constants, changed.constants)
        )
        if not taken <= left * (1.0 + 1e-9) + 1e-9:
            yield Finding(
                where,
                f"{name} = {1.25 * value:g} moves the command by {taken:.3g} N m at once, "
                f"by {left:.3g} N m with the memory left alone",
                "choose the memory so that the command stays",
            )
            return


def _tunable(law: Law) -> dict[str, float]:
    """Return the law's own parameters of one number that may change while it runs."""
    shared = set(declarations(ControllerConfig))
    values = values_of(law.config())
    return {
        name: float(value)
        for name, declared in declarations(law.config).items()
        if name not in shared
        and not declared.fixed
        and isinstance(value := values[name], float)
        and value != 0.0
    }


def keeps_time(law: Law) -> Iterator[Finding]:
    """Yield if the command depends on how many samples were taken, not on time."""
    efforts = []
    for dt in (DT, DT / 5.0):
        driven = Driven(law, 1e9)
        for sample in steady(round(0.5 / dt), dt):
            driven.update(sample)
        efforts.append(driven.memory.effort)
    coarse, fine = efforts
    if abs(fine - coarse) > 0.05 * (abs(coarse) + 1.0):
        yield Finding(
            name_of(law.update),
            f"0.5 s at an error of 0.2 rad give {coarse:.6g} N m with dt = {DT:g} s, {fine:.6g} N m with "
            f"dt = {DT / 5.0:g} s",
            "multiply what is added up by sample.dt, divide differences by it",
        )


_SHORT = ("simulator.duration=2.0",)


def short_plan(law: Law) -> RunPlan:
    """Return the demo's run with this law, of some seconds."""
    return make_plan("demo", law.name, settings=_SHORT)


def recomputed(law: Law) -> Iterator[Finding]:
    """Yield a finding where a recorded run differs from its recomputation."""
    advice = "keep everything that decides a command in memory, sample and parameters"
    return recomputes(short_plan(law), name_of(law.update), advice)


def compiled(law: Law) -> Iterator[Finding]:
    """Yield a finding where compiled code differs from CPython; note what numba refuses."""
    plan = short_plan(law)

    def slower() -> str:
        usual = _seconds(make_plan("demo", "pid", settings=_SHORT))
        return f"{_seconds(plan) / max(usual, 1e-9):.0f} times slower"

    return compiles(plan, name_of(law.update), slower)


def in_lanes(law: Law) -> Iterator[Finding]:
    """Yield a finding where a run in a lane has other bits than alone; note what keeps it from lanes."""
    if strange := without_row(law.memory):
        advice = f"remember numbers, flags and tuples of them; {ALONE}"
        yield Finding(name_of(type(law.memory)), strange, advice, note=True)
        return
    yield from runs_in_lanes(short_plan(law), name_of(law.update))


def linearises(law: Law) -> Iterator[Finding]:
    """Note why a law has no linear model: no margins, no Floquet multipliers."""
    from trunk_studies.tuning.linear import law_slopes

    config = law.config()
    try:
        law_slopes(law, config.constants, config.limits, DT, [STILL])
    except PlanError as error:
        advice = "until then trunk margins refuses it, and trunk study map draws no multipliers"
        yield Finding(name_of(law.update), str(error), advice, note=True)


def exports(law: Law) -> Iterator[Finding]:
    """Note what the translator to C refuses: its function, line and expression, and what to write instead."""
    from ..export_c.library import ExportedController

    try:
        ExportedController(law, law.config())
    except UntranslatableError as error:
        yield untranslated(error, "trunk export-c refuses it")


def _seconds(plan: RunPlan) -> float:
    run_compiled(plan)
    begun = process_time()
    run_compiled(plan)
    return process_time() - begun


CHECKS: tuple[Check[Law], ...] = (
    Check("declared", "its parameters have descriptions, bounds and units", declares),
    Check("defaults", "config/default.yaml, if any, has its parameters", in_default_file),
    Check("names", "no term has the name of a field that every record has", named),
    Check("types", "an update returns what is declared", types),
    *source_checks(roots_of, CONTRACT),
    Check("pure", "the same inputs give the same outputs", pure),
    Check("finite", "no input makes it non-finite", finite_always),
    Check("holds", "it holds memory and command if a sample is not usable", holds),
    Check("limits", "its commands stay within the limits", within_limits),
    Check("reset", "after a reset it behaves like new", reset),
    Check("transfer", "it takes over without a jump", transfers),
    Check("reconfigure", "it takes new parameters without adding a jump", reconfigures),
    Check("time", "it depends on time, not on the number of samples", keeps_time),
    Check("quick", "an update takes less than 0.2 ms", quick),
    Check("compiled", "compiled code gives the same bits", compiled),
    Check("lanes", "its runs go side by side in lanes, with the same bits", in_lanes),
    Check("linear", "it has a linear model about the upright", linearises),
    Check("exportable", "it can be written as C with the same bits", exports),
    Check("replay", "a recording with it verifies", recomputed),
)
KIT = Kit("law", law_named, lambda law: law.update, CHECKS)
findings_of = KIT.findings_of
conformance = KIT.conformance
