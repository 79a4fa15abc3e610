"""An exported controller's C library: header, source, CMakeLists.txt, and a replay.

The replay has a recording's states and commands: what the exported controller has to answer, bit by bit.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from importlib.metadata import version
from math import inf
from string import Template
from struct import pack

from trunk_control.decide import Reading, active_at
from trunk_control.law import Hip
from trunk_core import topics
from trunk_core.c.program import ARITHMETIC as PRELUDE
from trunk_core.c.program import INCLUDES, RESERVED, definition, real_literal, template
from trunk_core.c.translate import indented
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import Declaration, declarations, values_of
from trunk_core.topics import Event
from trunk_core.units import seconds
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.provenance import ARITHMETIC
from trunk_runs.timeline import Change

from .exported_controller import CELLS, ExportedController, ExportedStep

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
