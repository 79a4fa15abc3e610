"""A registered law with its parameters as a C library: what is translated, and the files that it makes.

Header, source, CMakeLists.txt, and a replay, which has a recording's states and commands: what the exported
controller has to answer, bit by bit.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from importlib.metadata import version
from math import inf, isfinite
from pathlib import Path
from string import Template
from struct import pack
from typing import Any, NamedTuple

import numpy as np

from trunk_control.controller import Controller, settings_of
from trunk_control.decide import (
    Output,
    Reading,
    Seen,
    activated,
    active_at,
    deactivated,
    decide,
    initial_state,
    reconfigured,
)
from trunk_control.law import ControllerConfig, Hip, Law
from trunk_control.laws import package_of
from trunk_core import topics
from trunk_core.c.program import ARITHMETIC as PRELUDE
from trunk_core.c.program import INCLUDES, RESERVED, definition, real_literal, template
from trunk_core.c.translate import Program, indented
from trunk_core.c.types import RecordType, Static, Type, type_of
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    changed,
    declarations,
    value_of,
    values_of,
)
from trunk_core.topics import Event
from trunk_core.units import nanoseconds, seconds
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.provenance import ARITHMETIC
from trunk_runs.timeline import Change

_PUBLIC = ("reset", "update", "activate", "deactivate", "parameters", "retune", "self_test")
_ANSWERS = 8  # of the self-test
_FACTORS = (1.0009765625, 0.9990234375, 1.0732421875, 0.8798828125)

# The numbers of an input, as files and tables have them: their names, their types in C.
CELLS = {
    "stamp_ns": "int64_t",
    **dict.fromkeys(("position", "velocity", "hip_position", "hip_velocity", "effort"), "double"),
    "has_reference": "bool",
    "reference": "double",
}


class ExportedStep(NamedTuple):
    """An input of the controller, the answer of CPython or of a recording, and whether it is compared."""

    reading: Reading
    effort: float
    compared: bool

    @property
    def numbers(self) -> tuple[int | float, ...]:
        """The input's `CELLS`, and the answer."""
        r = self.reading
        motion = (r.position, r.velocity, *r.hip, r.effort)
        return r.stamp_ns, *motion, r.has_reference, r.reference, self.effort


class Leaf(NamedTuple):
    """A parameter that is a number of the constants: its declaration, its name and its place in C."""

    declaration: Declaration
    name: str
    place: str  # behind the constants


@dataclass
class ExportedController:
    """A controller's translation. ``name``: in C, by default the law's.

    Raises UntranslatableError for a law outside of the subset.
    """

    law: Law
    config: ControllerConfig
    name: str = ""
    program: Program = field(init=False)

    def __post_init__(self) -> None:
        self.name = self.name or self.law.name
        self.program = p = Program(f"{self.name}_")
        p.names |= {f"{self.name}_{public}" for public in _PUBLIC}
        p.names |= {f"{self.name}_{n}" for n in ("Controller", "Parameters", "widened")}
        p.names |= {"SETTINGS", "INITIAL"}
        law, config = self.law, self.config
        self.settings = settings_of(config, law)
        memory_class = (type(law.memory),)
        self.constants_type: Type = type_of(config.constants)
        assert isinstance(self.constants_type, RecordType)
        if self.constants_type.kind is None:
            p.titles[self.constants_type] = "Constants"
        self.settings_type = type_of(self.settings, changing=memory_class)
        memory = self.settings.initial
        self.initial = initial_state(not config.active_times, Seen(), memory)
        self.state_type = state = type_of(self.initial, changing=memory_class)
        self.input_type = type_of(Reading(0, 0.0, 0.0))
        output = Output(False, 0.0, False, False, 0.0, self.settings.no_terms)
        self.output_type = type_of(output)
        for t in (state, self.constants_type, self.input_type, self.output_type):
            p.c_type(t)
        self.public_records = list(p.records)  # of the header; the others are of the source alone
        functions = [Static(law.update), Static(law.transfer)]
        given = [state, self.input_type, self.settings_type, self.constants_type, *functions]
        assert isinstance(self.settings_type, RecordType)
        self.update = p.function(decide, given)
        self.activate = p.function(activated, [state, self.settings_type.types[1]])
        self.deactivate = p.function(deactivated, [state])
        limits = self.settings_type.types[0]
        tuned = [state, Static(law), self.constants_type, self.constants_type, limits]
        self.retune = p.function(reconfigured, tuned)
        self.leaves = list(_leaves_of(config, p, self.constants_type))

    @property
    def values(self) -> dict[str, Any]:
        """The parameters by their names."""
        return values_of(self.config)

    # What is told about it -------------------------------------------------------------------------------

    @property
    def digest(self) -> str:
        """The digest of the parameters: 16 hex digits of SHA-256 over their names and values, sorted."""
        values = {name: repr(value) for name, value in sorted(self.values.items())}
        return sha256(json.dumps(values).encode()).hexdigest()[:16]

    @property
    def fingerprint(self) -> str:
        """The fingerprint of the sources that were translated: 16 hex digits of SHA-256."""
        files = {Path(f.python.__code__.co_filename) for f in self.program.functions.values()}
        digest = sha256()
        for path in sorted(files, key=lambda path: (path.name, str(path))):
            digest.update(path.read_bytes())
        return digest.hexdigest()[:16]

    @property
    def package(self) -> str:
        """The package of the law."""
        try:
            return package_of(self.law.name)
        except KeyError:  # not registered
            return str(self.law.update.__module__).partition(".")[0]

    @property
    def licence(self) -> str:
        """The licence of the law's package."""
        from importlib.metadata import PackageNotFoundError, metadata

        try:
            return str(metadata(self.package)["License"] or "see its package")
        except (PackageNotFoundError, KeyError):
            return "see its package"

    # What CPython answers --------------------------------------------------------------------------------

    def answers(self, count: int = _ANSWERS) -> list[ExportedStep]:
        """Return inputs around the upright, and CPython's answers; every update is due."""
        rng = random.Random(self.digest)
        readings = []
        for k in range(count):
            theta, omega, x, v, acting = (rng.uniform(-0.5, 0.5) for _ in range(5))
            readings.append(
                Reading(k * self.config.period_ns, theta, 4.0 * omega, Hip(x, v), 20.0 * acting)
            )
        controller = Controller(self.config, self.law)
        outputs = [(reading, controller.decide(reading)) for reading in readings]
        return [ExportedStep(reading, out.effort, out.active) for reading, out in outputs]


COMPUTED = ""
# What a parameter's value is as a number of each kind.
_KINDS: dict[str, Callable[[Any], float]] = {
    "real": float,
    "integer": lambda value: value,
    "ns": lambda value: nanoseconds(value) if isfinite(value) else value,
}


def made_of(
    values: Iterable[Any], numbers: Callable[[Any], Iterable[object]]
) -> dict[Any, list[str]]:
    """Return the numbers that are made of each allowed value of a parameter, exactly, as texts."""
    made = {}
    for value in values:
        with suppress(ParameterError, PlanError):
            made[value] = [
                repr(number.item() if isinstance(number, np.generic) else number)
                for number in numbers(value)
            ]
    return made


def form_of(made: Mapping[Any, Sequence[str]]) -> list[str] | None:
    """Return what each number is, made of several values: its text, or the kind as which it is the value.

    COMPUTED: it changes in another way; None: they are not as many for each value.
    """
    if len(set(map(len, made.values()))) > 1:
        return None
    return [_kind(made, texts) for texts in zip(*made.values(), strict=True)]


def _kind(values: Iterable[Any], texts: Sequence[str]) -> str:
    if len(set(texts)) == 1:
        return texts[0]
    for kind, number in _KINDS.items():
        if all(repr(number(v)) == text for v, text in zip(values, texts, strict=True)):
            return kind
    return COMPUTED


def varying(form: Sequence[str]) -> list[int]:
    """Return the indices of the numbers that change with the parameter."""
    return [i for i, text in enumerate(form) if text == COMPUTED or text in _KINDS]


def _leaves_of(config: ControllerConfig, program: Program, t: Type) -> Iterator[Leaf]:
    """Yield the parameters that may change while the controller runs and are one number of its constants."""
    places = [place for place, _ in _numbers(program, config.constants, t)]

    def numbers(name: str, value: float) -> list[object]:
        constants = changed(config, {name: value}).constants
        return [number for _, number in _numbers(program, constants, t)]

    for name, declared in declarations(type(config)).items():
        if declared.fixed or declared.kind != "double":
            continue
        now: Any = value_of(config, name)
        values = (now, *((now or 0.001953125) * factor for factor in _FACTORS))
        form = form_of(made_of(values, partial(numbers, name))) or ()
        match varying(form):
            case [i] if form[i] == "real":
                yield Leaf(declared, name.replace(".", "_"), places[i])


def _numbers(program: Program, value: Any, t: Type, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the numbers of a value, everything else as it is, and their places."""
    if isinstance(t, RecordType):
        for i, (item, inner) in enumerate(zip(value, t.types, strict=True)):
            yield from _numbers(program, item, inner, f"{place}.{program.field(t, i)}")
    else:
        yield place, value


# From a recording, and what a replay reads ---------------------------------------------------------------

MAGIC = 0x54524E4B43303031  # in the byte order of the target
SWINGING = 2000  # states, where there is no recording


def recorded_rows(run: RecordedRun, e: ExportedController) -> list[ExportedStep]:
    """Return the states that a controller of a recording got, and its commands.

    Raises PlanError for a run whose commands do not follow from its states and these parameters alone.
    """
    plan = run.plan()
    name = e.law.name
    if name not in plan.controllers:
        raise PlanError(
            f"--like {run.path}: {', '.join(plan.controllers) or 'no controller of ours'} ran in it, "
            f"not {name}: give a recording with {name}"
        )
    _check_parameters(run, e)
    if plan.inputs is not None:
        raise PlanError(
            f"--like {run.path}: it ran in real time, and the controller did not get every state: "
            "give an offline run or one in lock-step"
        )
    # That it acts from the first state on is an event of a run in the graph.
    begins = Change(-1, None, Event.ACTIVATED)
    changes = [change for change in plan.changes.get(name, ()) if change != begins]
    if changes:
        at = seconds(changes[0].stamp_ns)
        raise PlanError(
            f"--like {run.path}: {name} was changed, reset or switched by hand at t = {at:g} s: "
            "give a recording without that"
        )
    states, commands = run.table(topics.JOINT_STATES), run.table(topics.EFFORT_COMMAND)
    joint = states.index(e.config.joint)
    hip = None if e.config.hip is None else states.index(e.config.hip)
    place = commands.index(e.config.joint)
    given = commands.values("effort")[:, place]
    position, velocity = states.values("position"), states.values("velocity")
    effort = states.values("effort")
    times = e.config.active_times_ns
    reference: float | None = None
    rows = []
    for k, stamp_ns in enumerate(states.stamp_ns.tolist()):
        reference = plan.references.get(stamp_ns, reference)
        motion = Hip() if hip is None else Hip(float(position[k, hip]), float(velocity[k, hip]))
        row = commands.row(stamp_ns)
        answered = row is not None and active_at(times, stamp_ns)
        reading = Reading(
            stamp_ns,
            float(position[k, joint]),
            float(velocity[k, joint]),
            motion,
            float(effort[k, joint]),
            reference is not None,
            reference or 0.0,
        )
        rows.append(ExportedStep(reading, float(given[row]) if answered else 0.0, answered))
    return rows


def _check_parameters(run: RecordedRun, e: ExportedController) -> None:
    mine, theirs = values_of(e.config), values_of(run.config(e.law.name))
    for name, value in mine.items():
        acts = name not in ("autostart", "lockstep.enabled")
        if acts and repr(theirs.get(name)) != repr(value):
            raise PlanError(
                f"--like {run.path}: {e.law.name} ran with {name} = {theirs.get(name)}, not {value}: leave "
                "out --params and --set, or record a run with them"
            )


def packed(rows: Sequence[ExportedStep]) -> bytes:
    """Return rows as replay.c reads them: 64 bits a number, little-endian."""
    chunks = [pack("<qdddddqddq", *row.numbers, row.compared) for row in rows]
    return b"".join([pack("<qq", MAGIC, len(rows)), *chunks])


# What NAME_self_test() returns: 0, 1, ...
FAULTS = {
    "SOUND": "sound",
    "CONTRACTED": "the processor contracts a product and a sum: compile with -ffp-contract=off",
    "EXTENDED": "sums have more bits than a double, or another order: no -ffast-math, no x87",
    "ROUNDED": "it does not round to the nearest",
    "FLUSHED": "small numbers are flushed to zero",
    "DIFFERENT": "an answer is not CPython's",
    "SINGLE": "constants are of single precision: compile without -fsingle-precision-constant",
}
ROW_BYTES = 80
_NAME = re.compile(
    r"""(?! ( assert | complex | ctype | errno | fenv | inttypes | iso646 | limits | locale | math | setjmp
    | signal | std\w+ | string | tgmath | threads | time | uchar | wchar | wctype  # headers of C
    | replay | all | clean | help | install | package | test ) \Z )  # our own file, targets of CMake
    [a-z] (_?[a-z0-9]){0,63}""",
    re.ASCII | re.IGNORECASE | re.VERBOSE,
)


def check_name(name: str) -> str:
    """Return a name for an export's functions and files. Raises PlanError if it cannot be one."""
    if name in RESERVED or not _NAME.fullmatch(name):
        raise PlanError(
            f"--name {name}: allowed are up to 64 letters, digits and single _, the first a letter, but no "
            "word of C or C++, header of C, target of CMake or replay: give another, such as left_hip"
        )
    return name


def base_files(e: ExportedController, rows: Sequence[ExportedStep]) -> dict[str, bytes]:
    """Return header, source, replay.c with its states, and CMakeLists.txt."""
    values = {"row_bytes": ROW_BYTES, "magic": MAGIC, "fill": fill_from_bytes(e)}
    return {
        f"{e.name}.h": header(e).encode(),
        f"{e.name}.c": source(e).encode(),
        "replay.c": filled("replay.c", e, **values).encode(),
        f"{e.name}.states": packed(rows),
        "CMakeLists.txt": filled("CMakeLists.txt", e).encode(),
    }


# Header and source --------------------------------------------------------------------------------------


def heading(e: ExportedController, purpose: str) -> str:
    """Return the comment at the top of a file."""
    return f"""/* {e.law.label}: {purpose}.
 *
 * Written by trunk export-c {version("trunk_experiments")}; do not edit.
 * controller  {e.law.name} of {e.package}
 * parameters  {e.digest}
 * sources     {e.fingerprint}
 * arithmetic  {ARITHMETIC}
 * licence     {e.licence}
 */"""


def header(e: ExportedController) -> str:
    """Return NAME.h."""
    p, n = e.program, e.name
    parameters, tuning = "", ""
    if e.leaves:
        fields = [f"    double {leaf.name}; /* {_about(leaf.declaration)} */" for leaf in e.leaves]
        parameters = "\n".join(
            [
                "\n/* Parameters that may change while the controller runs. */",
                *("typedef struct {", *fields, f"}} {n}_Parameters;\n"),
            ]
        )
        tuning = f"\n{filled('tuning.h', e)}"
    text = filled(
        "header.h",
        e,
        period_ns=e.config.period_ns,
        records="\n\n".join(map(p.structure, e.public_records)),
        state=p.c_type(e.state_type),
        constants=p.c_type(e.constants_type),
        parameters=parameters,
        update=_update_head(e),
        tuning=tuning,
        gap_ns=e.settings.gap_ns,
        faults="\n".join(
            f"#define {n.upper()}_{fault} {i} /* {text} */"
            for i, (fault, text) in enumerate(FAULTS.items())
        ),
    )
    digest = sha256(f"{text}{source(e)}".encode()).hexdigest()[:16]
    guard = filled("guard.h", e, content=digest, CONTENT=digest.upper(), text=text)
    return f"{heading(e, 'its interface')}\n{guard}"


def source(e: ExportedController) -> str:
    """Return NAME.c."""
    public, p = _public(e), e.program
    kind = p.c_type(e.settings_type)
    statics = f"""static const {kind} SETTINGS = {p.initial(e.settings, e.settings_type)};

static const {e.name}_Controller INITIAL = {{
    {p.initial(e.initial, e.state_type, 2)},
    {p.initial(e.config.constants, e.constants_type, 2)},
}};"""
    parts = [
        heading(e, "its functions, translated from Python"),
        f'#include "{e.name}.h"',
        INCLUDES,
        PRELUDE,
        *(p.structure(record) for record in p.records if record not in e.public_records),
        p.text(f"{statics}\n{public}"),
        statics,
        public,
    ]
    return "\n\n".join(parts)


def filled(name: str, e: ExportedController, **values: object) -> str:
    """Return a template's text with the controller's names and these values."""
    about = {"name": e.name, "NAME": e.name.upper(), "label": e.law.label, "digest": e.digest}
    about["fault_texts"] = "\n".join(f'    "{text}",' for text in FAULTS.values())
    return (
        Template(template(name, __package__)).substitute(about, licence=e.licence, **values) + "\n"
    )


def _about(declared: Declaration) -> str:
    return f"{declared.name}{f', {declared.unit}' if declared.unit else ''}"


def _update_head(e: ExportedController) -> str:
    given, answer = e.program.c_type(e.input_type), e.program.c_type(e.output_type)
    takes = f"const {given} *reading, {answer} *output"
    return f"void {e.name}_update({e.name}_Controller *controller, {takes})"


def _public(e: ExportedController) -> str:
    """Return the functions of the interface: they hand parts of the controller to what was translated."""
    n, p, state = e.name, e.program, "controller->state"
    next_of = f"{e.update.name}(&{state}, reading, &SETTINGS, &controller->constants)"
    widened = "*wide += (uint32_t)(count - (uint32_t)*wide)"
    bodies = {
        f"void {n}_reset({n}_Controller *controller)": ["*controller = INITIAL;"],
        _update_head(e): [
            f"const {p.c_type(e.update.result)} next = {next_of};",
            f"{state} = next.item0;",
            "*output = next.item1;",
        ],
        f"void {n}_activate({n}_Controller *controller)": [
            f"{state} = {e.activate.name}(&{state}, &SETTINGS.initial);"
        ],
        f"void {n}_deactivate({n}_Controller *controller)": [
            f"{state} = {e.deactivate.name}(&{state});"
        ],
        f"int64_t {n}_widened(int64_t *wide, uint32_t count)": [f"return {widened};"],
    }
    parts = ["\n".join([f"{head} {{", *indented(body), "}\n"]) for head, body in bodies.items()]
    return "\n".join([*parts, *([_tuning(e)] if e.leaves else []), _self_test(e)])


def _tuning(e: ExportedController) -> str:
    given = [f"parameters->{leaf.name}" for leaf in e.leaves]
    pairs = list(zip(given, e.leaves, strict=True))
    return filled(
        "tuning.c",
        e,
        reads="\n".join(f"    {p} = controller->constants{leaf.place};" for p, leaf in pairs),
        checks="\n".join(f"    sound = sound && {check};" for check in _checks(e)),
        writes="\n".join(f"    after{leaf.place} = {p};" for p, leaf in pairs),
        constants=e.program.c_type(e.constants_type),
        retune=e.retune.name,
    )


def _checks(e: ExportedController) -> Iterator[str]:
    """Yield the conditions of new parameters: each one's range, and the declared rules that join two."""
    new = {leaf.declaration.name: f"parameters->{leaf.name}" for leaf in e.leaves}
    for leaf in e.leaves:
        yield _range(leaf.declaration, new[leaf.declaration.name])
    for name, declared in declarations(type(e.config)).items():
        joined = {n: new.get(n) or f"{e.values[n]!r}" for n in (name, declared.at_least) if n}
        if declared.at_least and not new.keys().isdisjoint(joined):
            yield " >= ".join(joined.values())


def _range(declared: Declaration, value: str) -> str:
    """Return the condition of a parameter's range; false for NaN."""
    bounds = ((declared.minimum, ">="), (declared.above, ">"), (declared.maximum, "<="))
    terms = [
        f"{value} {sign} {real_literal(float(bound))}"
        for bound, sign in bounds
        if bound is not None and abs(bound) < inf
    ]
    if not declared.unbounded:
        terms.append(f"{value} - {value} == 0.0")
    return " && ".join(terms) or f"{value} == {value}"


def _self_test(e: ExportedController) -> str:
    rows = [[number for number in row.numbers if isinstance(number, float)] for row in e.answers()]
    reals = [name for name, kind in CELLS.items() if kind == "double"]
    cells = {name: f"row[{i}]" for i, name in enumerate(reals)}
    cells |= {"stamp_ns": f"i * {e.name.upper()}_PERIOD_NS", "has_reference": "false"}
    return filled(
        "self_test.c",
        e,
        rows=len(rows),
        columns=len(reals) + 1,
        last=len(reals),
        table="\n".join(f"        {{{', '.join(map(definition, row))}}}," for row in rows),
        fill=fill(e, cells, 2),
    )


def fill_from_bytes(e: ExportedController) -> str:
    """Return the statements of `fill` for cells in a row of bytes as `packed` writes it."""
    kinds = {"double": "real_at({})", "int64_t": "integer_at({})", "bool": "integer_at({}) != 0"}
    places = enumerate(CELLS.items())
    cells = {name: kinds[kind].format(f"bytes + {8 * i}") for i, (name, kind) in places}
    return fill(e, cells, 2)


def fill(e: ExportedController, cells: Mapping[str, str], depth: int) -> str:
    """Return statements that make an update's input of these `CELLS`, update, and leave the ``effort``."""
    lines = [
        f"{e.program.c_type(e.input_type)} reading;",
        *(f"reading.{name.replace('hip_', 'hip.')} = {cells[name]};" for name in CELLS),
        f"{e.program.c_type(e.output_type)} output;",
        f"{e.name}_update(&controller, &reading, &output);",
        "const double effort = output.effort;",
    ]
    return "\n".join(f"{'    ' * depth}{line}" for line in lines)
