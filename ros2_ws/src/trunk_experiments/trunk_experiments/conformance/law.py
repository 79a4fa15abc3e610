"""The conformance kit: whether a law meets the contract of all laws.

Each check is a function of a law that yields findings. `conformance` applies them by a registered name;
the same checks are test functions for a package's own tests.
"""

from __future__ import annotations

import ast
import builtins
import copy
import inspect
import math
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, isfinite, nan
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from traceback import extract_tb
from types import FunctionType, ModuleType
from typing import Annotated, Any, NamedTuple

from trunk_control.controller import Controller
from trunk_control.controller_config import ControllerConfig
from trunk_control.law import Hip, Law, Sample, from_scratch, unchanged
from trunk_control.laws import law_named
from trunk_control.limits import Limits, limited
from trunk_msgs_util.compiled import call_graph
from trunk_msgs_util.elementary import LARGEST_ANGLE, cos, sin, sincos
from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.parameters.declarations import (
    Declaration,
    ParameterError,
    build,
    declarations,
    listed,
    table_of,
    values_of,
)
from trunk_msgs_util.parameters.files import ParameterFileError, read
from trunk_msgs_util.recording.reader import Recording

from ..plans.plan import RunPlan, make_plan
from ..results import OMITTED, Named


class LawFinding(NamedTuple):
    """A breach of the contract by a law, or a note about it."""

    check: Annotated[str, OMITTED]
    function: Annotated[str, "MODULE.FUNCTION"]
    problem: Annotated[str, Named("what"), "With the input that shows it"]
    advice: Annotated[str, "What to do"]
    note: Annotated[bool, "To know, not to mend"] = False

    def line(self) -> str:
        """Return it as one line."""
        return f"{self.check}: {self.function}: {self.problem}: {self.advice}"


@dataclass(frozen=True)
class LawCheck:
    """A check: its name, what it asserts, and its function of a law."""

    name: str
    asserts: str
    run: Callable[[Law], Iterator[LawFinding]]


def name_of(function: Any) -> str:
    """Return a function's module and name."""
    return f"{function.__module__}.{function.__qualname__}"


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


def numbers_in(record: Any) -> Iterator[float]:
    """Yield the numbers of a record, nested ones too."""
    if isinstance(record, tuple | list):
        for part in record:
            yield from numbers_in(part)
    elif isinstance(record, int | float):
        yield float(record)


def finite(record: Any) -> bool:
    """Return True if all numbers of a record are finite."""
    return all(map(isfinite, numbers_in(record)))


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


def swinging(duration: float, dt: float = DT, amplitude: float = 0.3) -> list[Sample]:
    """Return smooth samples of a trunk that swings at 1 Hz around a reference of 0.1 rad."""
    turn = 6.283185307179586
    samples = []
    for k in range(round(duration / dt)):
        angle = turn * k * dt
        hip = Hip(0.2 * k * dt, 0.2)
        samples.append(Sample(0.1, amplitude * sin(angle), amplitude * turn * cos(angle), dt, hip))
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


def bounded(law: Law) -> Iterator[LawFinding]:
    """Yield parameters without a description, bounds or a unit."""
    for name, declared in _own(law).items():
        where = f"{name_of(law.config)} {name}"
        if not declared.description.strip():
            yield LawFinding("declared", where, "has no description", "say in a phrase what it is")
        if isinstance(declared.default, str | bool | tuple) and not isinstance(
            next(iter(numbers_in(declared.default)), None), float
        ):
            continue
        limited_below = declared.minimum is not None or declared.above is not None
        if not declared.unbounded and not (limited_below and declared.maximum is not None):
            yield LawFinding(
                "declared", where, "has no bounds", "give minimum or above, and maximum"
            )
        if not declared.unit and isinstance(declared.default, float):
            yield LawFinding(
                "declared",
                where,
                "has no unit",
                "give unit=..., in SI; none for a ratio",
                note=True,
            )


def named(law: Law) -> Iterator[LawFinding]:
    """Yield names of terms that hide what every record has, and terms without a unit."""
    for name in law.terms._fields:
        if name in ("reference", "measurement"):
            yield LawFinding(
                "names",
                name_of(law.terms),
                f"has a field {name!r}, which every record already has",
                "leave it out or rename it",
            )
    missing = [name for name in law.terms._fields[:-3] if name not in law.units]
    if missing:
        yield LawFinding(
            "names",
            name_of(law.terms),
            f"{', '.join(missing)}: without a unit",
            "give it in Law(units=...), an empty one for a ratio",
            note=True,
        )


def in_default_file(law: Law) -> Iterator[LawFinding]:
    """Yield differences in parameters between the law and the package's ``config/default.yaml``."""
    package = sys.modules[law.config.__module__.partition(".")[0]]
    # The one in the sources, to which colcon's build folder may link.
    path = Path(package.__file__ or "").resolve().parent / "config" / "default.yaml"
    if not path.is_file():
        return
    try:
        layer = read(path)
    except ParameterFileError as error:
        yield LawFinding("defaults", str(path), str(error), "correct the file, or delete it")
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
            yield LawFinding(
                "defaults", str(path), f"sets {name}, which the law does not declare", advice
            )
    for name, declared in _own(law).items():
        where = f"{name}, default {declared.default}"
        if name not in covered:
            yield LawFinding("defaults", str(path), f"lacks {where}", "add it, or delete the file")
        elif isinstance(given.get(name), int | float) and given[name] != declared.default:
            problem = f"has {name}: {given[name]}, the law's default is {declared.default}"
            yield LawFinding(
                "defaults", str(path), problem, "write the law's value, if that is meant", note=True
            )


def _own(law: Law) -> dict[str, Declaration]:
    shared = declarations(ControllerConfig)
    return {name: d for name, d in declarations(law.config).items() if name not in shared}


# Exact, or rounded correctly everywhere.
_EXACT = {
    *("inf", "nan", "pi", "tau", "e", "floor", "ceil", "trunc", "sqrt", "fabs", "copysign"),
    *("isfinite", "isinf", "isnan", "fmod", "nextafter", "ulp"),
}
_BUILTINS = {
    *("abs", "bool", "divmod", "enumerate", "float", "int", "len", "max", "min", "range", "round"),
    *("tuple", "zip", "isinstance", "all", "any", "True", "False", "None"),
}
_OURS = ("trunk_control.", "trunk_msgs_util.")
_PORTABLE = (
    "use sin, cos, atan2, exp, log, tanh, sqrt of trunk_control.api: the same bits on every machine, "
    f"and NaN from sin and cos beyond +-{LARGEST_ANGLE:.0f} rad"
)


def functions_of(law: Law) -> list[FunctionType]:
    """Return the law's functions, and those of its own package that they call."""
    roots: list[Any] = [law.update]
    roots += [
        function
        for function in (law.transfer, law.reconfigure)
        if function not in (from_scratch, unchanged)
    ]
    if law.lookup is not None:
        roots += [law.lookup.inputs, law.lookup.cell, law.lookup.near]
    functions: dict[FunctionType, None] = {}
    for root in roots:
        if isinstance(root, FunctionType):
            functions.update(dict.fromkeys(call_graph(root)))
    return list(functions)


def pure_source(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a function keeps state, reads a clock, draws at random or touches files."""
    if not isinstance(law.update, FunctionType):
        yield LawFinding(
            "source",
            repr(law.update),
            f"is a {type(law.update).__name__}",
            "a plain function is needed: its source is hashed, compiled and checked",
        )
    for function in functions_of(law):
        for problem in _problems(function):
            if problem.check == "source":
                yield problem


def portable_source(law: Law) -> Iterator[LawFinding]:
    """Yield calls of functions whose rounding depends on the machine's mathematical library."""
    for function in functions_of(law):
        for problem in _problems(function):
            if problem.check == "portable":
                yield problem


def _problems(function: FunctionType) -> Iterator[LawFinding]:
    if function.__module__.startswith(_OURS):
        return
    where = name_of(function)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, SyntaxError):
        yield LawFinding("source", where, "has no source that can be read", "define it in a file")
        return
    for cell in function.__closure__ or ():
        if isinstance(cell.cell_contents, list | dict | set):
            yield _state(where, "keeps a mutable object in its closure")
    for value in function.__defaults__ or ():
        if isinstance(value, list | dict | set):
            yield _state(where, f"has the mutable default {value!r}")
    reported = set()
    for node in ast.walk(tree):
        for finding in _of_node(node, function, where):
            if finding.problem not in reported:
                reported.add(finding.problem)
                yield finding


def _of_node(node: ast.AST, function: FunctionType, where: str) -> Iterator[LawFinding]:
    if isinstance(node, ast.Global | ast.Nonlocal):
        yield _state(where, f"changes {', '.join(node.names)} outside itself")
    elif isinstance(node, ast.Import | ast.ImportFrom):
        yield LawFinding(
            "source", where, "imports while it runs", "import at the top of the module"
        )
    elif isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store):
        target = ast.unparse(node)
        yield _state(where, f"writes to {target}")
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        yield from _power(node, node.left, node.right, where)
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Pow):
        yield from _power(node, node.target, node.value, where)
    elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
        yield from _of_value(node, function, where)


def _power(node: ast.AST, base: ast.expr, exponent: ast.expr, where: str) -> Iterator[LawFinding]:
    """Yield a power that is not of whole numbers: CPython calls libm's pow where compiled code multiplies."""
    times = exponent.value if isinstance(exponent, ast.Constant) else None
    if isinstance(base, ast.Constant) and isinstance(base.value, int) and isinstance(times, int):
        return
    advice = "use exp and log of trunk_control.api, or multiply"
    if isinstance(times, int | float) and times in (2, 3, 4):
        factor = ast.unparse(base) if isinstance(base, ast.Constant) else f"({ast.unparse(base)})"
        advice = f"write {' * '.join([factor] * int(times))}"
    yield LawFinding("portable", where, f"computes {ast.unparse(node)}", advice)


def _of_value(node: ast.expr, function: FunctionType, where: str) -> Iterator[LawFinding]:
    known, value = _resolved(node, function)
    if not known:
        return
    shown = ast.unparse(node)
    if isinstance(value, list | dict | set | bytearray):
        yield _state(where, f"uses {shown}, a {type(value).__name__} that may change")
        return
    if isinstance(value, ModuleType | type):
        return
    module = getattr(value, "__module__", None) or ""
    if getattr(builtins, getattr(value, "__name__", ""), None) is value:
        if shown not in _BUILTINS:
            yield LawFinding("source", where, f"calls {shown}", "a law computes, and nothing else")
    elif module == "math" or getattr(math, shown.rsplit(".", 1)[-1], None) is value:
        if shown.rsplit(".", 1)[-1] not in _EXACT and callable(value):
            yield LawFinding("portable", where, f"calls {shown}", _PORTABLE)
    elif module.split(".")[0] == "numpy" or type(value).__module__.split(".")[0] == "numpy":
        if callable(value):
            yield LawFinding("portable", where, f"calls {shown} of NumPy", _PORTABLE)
        elif not isinstance(value, float):
            yield _state(where, f"uses {shown}, an array that may change")
    elif callable(value) and not isinstance(value, FunctionType):
        yield LawFinding(
            "source",
            where,
            f"calls {shown} of {module or type(value).__module__}",
            "no clock, no randomness, no files: a law computes from what it is given",
        )
    elif isinstance(value, FunctionType) and value not in call_graph(function):
        yield LawFinding(
            "source",
            where,
            f"calls {shown} of {value.__module__}, which is not checked",
            "no clock, no randomness, no files: a law computes from what it is given",
        )


def _resolved(node: ast.expr, function: FunctionType) -> tuple[bool, Any]:
    """Return whether a name is global or built in, and its value; attributes of modules likewise."""
    if isinstance(node, ast.Name):
        if node.id in function.__code__.co_varnames or node.id in function.__code__.co_freevars:
            return False, None
        if node.id in function.__globals__:
            return True, function.__globals__[node.id]
        if hasattr(builtins, node.id):
            return True, getattr(builtins, node.id)
        return False, None
    if isinstance(node, ast.Attribute):
        known, owner = _resolved(node.value, function)
        if known and isinstance(owner, ModuleType | type) and hasattr(owner, node.attr):
            return True, getattr(owner, node.attr)
        if known and isinstance(owner, FunctionType):
            return True, [owner]  # an attribute of a function is state
    return False, None


def _state(where: str, fault: str) -> LawFinding:
    return LawFinding("source", where, fault, "keep everything in the memory that update returns")


SLOWEST_US = 200.0
_LIMIT = 5.0


def types(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where an update returns other types than the law declares."""
    driven, update = Driven(law), name_of(law.update)
    sample = swinging(DT)[0]
    returned = law.update(driven.memory, sample, driven.constants, driven.limits)
    if not (type(returned) is tuple and len(returned) == 2):
        yield LawFinding("types", update, f"returns {returned!r}", "return (memory, terms)")
        return
    for part, record, kind in zip(
        ("memory", "terms"), returned, (type(law.memory), law.terms), strict=True
    ):
        if type(record) is not kind:
            yield LawFinding(
                "types",
                update,
                f"returns a {type(record).__name__} as {part}",
                f"return the {kind.__name__} that the law declares",
            )
            continue
        for field, value in zip(record._fields, record, strict=True):
            declared = getattr(law.memory, field) if part == "memory" else 0.0
            wanted = bool if field == "held" or isinstance(declared, bool) else type(declared)
            if type(value) is not wanted:
                yield LawFinding(
                    "types",
                    update,
                    f"{part}.{field} = {value!r} is {type(value).__name__}",
                    f"it is declared as {wanted.__name__}; compiled code needs one type",
                )


def pure(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where outputs depend on more than the inputs, or inputs are changed."""
    update, samples = name_of(law.update), swinging(1.0)
    driven = Driven(law)
    before = copy.deepcopy((driven.memory, driven.constants))
    first = driven.run(samples)
    if repr(before) != repr((law.memory, driven.constants)):
        yield LawFinding(
            "pure",
            update,
            "changes the memory or the constants that it is given",
            "return new ones",
        )
    Driven(law).run(swinging(0.7, amplitude=1.1))
    for k, (terms, repeated) in enumerate(zip(first, Driven(law).run(samples), strict=True)):
        if repr(terms) != repr(repeated):
            yield LawFinding(
                "pure",
                update,
                f"sample {k} of the same series gives {terms!r} once and {repeated!r} later",
                "take everything from memory, sample, constants and limits",
            )
            return


def finite_always(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where an input makes the command or the memory not finite, or raises."""
    update, hold = name_of(law.update), "return the memory as it was, and held = True"
    if sincos in functions_of(law):
        hold += f"; sin and cos of trunk_control.api are NaN beyond +-{LARGEST_ANGLE:.0f} rad"
    for sample in extreme():
        driven = Driven(law)
        driven.run(swinging(5 * DT))
        try:
            terms = driven.update(sample)
        except Exception as error:
            yield LawFinding(
                "finite",
                update,
                f"{given(sample)} raises {type(error).__name__}: {error}",
                "test `usable` first, and hold",
            )
            return
        if not (finite(driven.memory) and finite((terms.effort,))):
            yield LawFinding(
                "finite",
                update,
                f"{given(sample)} gives effort {terms.effort!r}, memory {tuple(driven.memory)!r}",
                f"hold where a result is not finite: {hold}",
            )
            return


def holds(law: Law) -> Iterator[LawFinding]:
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
            yield LawFinding(
                "holds",
                update,
                f"{given(sample)} gives held = {terms.held}, effort {terms.effort!r}, and "
                f"{'the same' if repr(driven.memory) == repr(before) else 'another'} memory",
                f"return the memory as it was, the command {wanted!r} and held = True",
            )
            return


def within_limits(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a command is not the unlimited one, limited, or the memory lacks it."""
    update = name_of(law.update)
    for limit in (_LIMIT, 0.01, 1e9):
        driven = Driven(law, limit)
        for sample in swinging(1.0, amplitude=1.5):
            terms = driven.update(sample)
            if not -limit <= terms.effort <= limit:
                yield LawFinding(
                    "limits",
                    update,
                    f"{given(sample)} within +-{limit:g} N m gives effort {terms.effort!r}",
                    "effort = limited(unsaturated, limits)",
                )
                return
            if not terms.held and (
                terms.effort != limited(terms.unsaturated, driven.limits)
                or driven.memory.effort != terms.effort
            ):
                yield LawFinding(
                    "limits",
                    update,
                    f"{given(sample)} gives unsaturated {terms.unsaturated!r}, effort {terms.effort!r}, "
                    f"memory.effort {driven.memory.effort!r}",
                    "effort = limited(unsaturated, limits), and memory.effort = effort",
                )
                return


def quick(law: Law) -> Iterator[LawFinding]:
    """Yield if the quickest of many updates takes too much of a control period."""
    driven, samples = Driven(law), swinging(0.2)
    best = float("inf")
    for _ in range(20):
        for sample in samples:
            begun = perf_counter()
            driven.update(sample)
            best = min(best, perf_counter() - begun)
    if best * 1e6 > SLOWEST_US:
        yield LawFinding(
            "quick",
            name_of(law.update),
            f"an update takes {best * 1e6:.0f} us at best, {SLOWEST_US:.0f} us is allowed",
            "move what does not depend on the sample into the configuration's constants",
        )


def reset(law: Law) -> Iterator[LawFinding]:
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
        yield LawFinding(
            "reset",
            name_of(law.update),
            f"update {k} after a reset gives {efforts[0][k]!r}, a new controller's {efforts[1][k]!r}",
            "keep nothing outside the memory",
        )


def transfers(law: Law) -> Iterator[LawFinding]:
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
                yield LawFinding(
                    "transfer",
                    name_of(law.transfer),
                    f"from {last:g} N m its command is {answer.effort!r} N m, one step may be {step:g} N m",
                    "keep to the limits given, which are narrowed during a bumpless transfer",
                )
                return
            if not controller.state.transfer.transferring:
                break
            last = answer.effort


def reconfigures(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where new parameters move the command more than with the memory left alone."""
    driven = Driven(law, 1e9)
    driven.run(steady(200))
    before = driven.memory.effort
    where = name_of(law.reconfigure)
    same = law.reconfigure(driven.memory, steady(1)[0], driven.constants, driven.constants)
    if repr(same) != repr(driven.memory):
        yield LawFinding(
            "reconfigure",
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
            yield LawFinding(
                "reconfigure",
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


def keeps_time(law: Law) -> Iterator[LawFinding]:
    """Yield if the command depends on how many samples were taken, not on time."""
    efforts = []
    for dt in (DT, DT / 5.0):
        driven = Driven(law, 1e9)
        for sample in steady(round(0.5 / dt), dt):
            driven.update(sample)
        efforts.append(driven.memory.effort)
    coarse, fine = efforts
    if abs(fine - coarse) > 0.05 * (abs(coarse) + 1.0):
        yield LawFinding(
            "time",
            name_of(law.update),
            f"0.5 s at an error of 0.2 rad give {coarse:.6g} N m with dt = {DT:g} s, {fine:.6g} N m with "
            f"dt = {DT / 5.0:g} s",
            "multiply what is added up by sample.dt, divide differences by it",
        )


_SHORT = ("simulator.duration=2.0",)


def short_plan(law: Law) -> RunPlan:
    """Return the demo's run with this law, of some seconds."""
    return make_plan("demo", law.name, settings=_SHORT)


def recomputes(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a recorded run differs from its recomputation."""
    from ..replay.verify import VERIFIED, verify
    from ..runs.offline_recording import record_offline

    with TemporaryDirectory(prefix="trunk-check-") as folder:
        path = Path(folder) / "run.mcap"
        try:
            record_offline(short_plan(law), path)
            verdict = verify(Recording.open(path))
        except TrunkError as error:
            yield LawFinding("replay", name_of(law.update), str(error), "see the other findings")
            return
    if verdict.exit_code != VERIFIED:
        said = "; ".join(verdict.reasons)
        yield LawFinding(
            "replay",
            name_of(law.update),
            f"trunk verify does not verify a run with it: {said}",
            "keep everything that decides a command in memory, sample and parameters",
        )


def compiles(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where compiled code differs from CPython; note what numba refuses."""
    from ..batch.check import first_difference
    from ..batch.compiled_run import Batch, NotCompiledWarning

    plan, update = short_plan(law), name_of(law.update)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        difference = first_difference(plan, Batch())
        refused = [w.message for w in caught if isinstance(w.message, NotCompiledWarning)]
        if refused:
            factor = _seconds(plan) / max(_seconds(make_plan("demo", "pid", settings=_SHORT)), 1e-9)
            yield LawFinding(
                "compiled",
                update,
                f"not compilable: {refused[0].reason}",
                f"sweeps will use CPython, {factor:.0f} times slower",
                note=True,
            )
    if difference is not None:
        yield LawFinding(
            "compiled",
            update,
            f"compiled code and CPython differ: {difference}",
            "compare with <, >, if; min, max and ** differ for NaN and -0.0",
        )


def exports(law: Law) -> Iterator[LawFinding]:
    """Note what the translator to C refuses: its function, line and expression, and what to write instead."""
    from ..export_c.controller import ExportedController
    from ..export_c.types import UntranslatableError

    try:
        ExportedController(law, law.config())
    except UntranslatableError as error:
        yield LawFinding(
            "exportable",
            f"{error.function}, line {error.line}",
            f"{error.text}: {error.problem}",
            f"{error.remedy}; until then trunk export-c refuses it",
            note=True,
        )


def _seconds(plan: RunPlan) -> float:
    from ..batch.compiled_run import Batch

    batch = Batch()
    batch.run(plan)
    begun = process_time()
    batch.run(plan)
    return process_time() - begun


__all__ = ["CHECKS", "LawCheck", "LawFinding", "conformance", "findings_of"]

CHECKS = (
    LawCheck("declared", "its parameters have descriptions, bounds and units", bounded),
    LawCheck("defaults", "config/default.yaml, if any, has its parameters", in_default_file),
    LawCheck("names", "no term has the name of a field that every record has", named),
    LawCheck("types", "an update returns what is declared", types),
    LawCheck("source", "no state, clock, randomness or file in its source", pure_source),
    LawCheck("portable", "the same bits on every machine", portable_source),
    LawCheck("pure", "the same inputs give the same outputs", pure),
    LawCheck("finite", "no input makes it non-finite", finite_always),
    LawCheck("holds", "it holds memory and command if a sample is not usable", holds),
    LawCheck("limits", "its commands stay within the limits", within_limits),
    LawCheck("reset", "after a reset it behaves like new", reset),
    LawCheck("transfer", "it takes over without a jump", transfers),
    LawCheck("reconfigure", "it takes new parameters without adding a jump", reconfigures),
    LawCheck("time", "it depends on time, not on the number of samples", keeps_time),
    LawCheck("quick", "an update takes less than 0.2 ms", quick),
    LawCheck("compiled", "compiled code gives the same bits", compiles),
    LawCheck("exportable", "it can be written as C with the same bits", exports),
    LawCheck("replay", "a recording with it verifies", recomputes),
)


def findings_of(name: str, check: LawCheck) -> list[LawFinding]:
    """Return a check's findings and notes on a registered law.

    Raises KeyError for a name that is not registered, LawError for a law that cannot be loaded.
    """
    law = law_named(name)
    try:
        return list(check.run(law))
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        function = f"{law.update.__module__}.{law.update.__qualname__}"
        law_file = law.update.__code__.co_filename
        lines = [f.lineno for f in extract_tb(error.__traceback__) if f.filename == law_file]
        if lines:
            function += f", line {lines[-1]}"
        return [LawFinding(check.name, function, f"raises {reason}", "a law never raises")]


def conformance(name: str, checks: Sequence[LawCheck] = CHECKS) -> list[LawFinding]:
    """Return a registered law's breaches of the contract; empty if it conforms. Notes are left out."""
    return [finding for check in checks for finding in findings_of(name, check) if not finding.note]
