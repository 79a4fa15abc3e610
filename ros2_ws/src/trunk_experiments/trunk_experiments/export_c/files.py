"""The files of an exported controller by their names: header, source, replay, CMakeLists.txt."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from importlib.metadata import version
from math import inf
from string import Template

from trunk_msgs_util.parameters.declarations import Declaration, declarations
from trunk_msgs_util.provenance import ARITHMETIC
from trunk_msgs_util.units import seconds

from ..errors import PlanError
from .controller import CELLS, ExportedController, ExportedStep
from .program import ARITHMETIC as PRELUDE
from .program import INCLUDES, RESERVED, definition, real_literal, template
from .replay import MAGIC, packed
from .translate import indented

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
_STAMPS = """ Stamps are ns from 0 up, in 64 bits. At one before the last update's, or more than
 * {} ns after the last state's, it starts afresh: integral and past are gone, `restarted` is true."""
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
 * controller  {e.law.name} of {e.package}{" (the law alone)" if e.bare else ""}
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
        turns="" if e.bare else f"\n{filled('turns.h', e)}",
        tuning=tuning,
        stamps="" if e.bare else _STAMPS.format(e.settings.gap_ns),
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
    public = _public(e)
    settings, kind = (e.settings.limits, e.limits_type) if e.bare else (e.settings, e.settings_type)
    p = e.program
    statics = f"""static const {p.c_type(kind)} SETTINGS = {p.initial(settings, kind)};

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
    return Template(template(name)).substitute(about, licence=e.licence, **values) + "\n"


def _about(declared: Declaration) -> str:
    return f"{declared.name}{f', {declared.unit}' if declared.unit else ''}"


def _names(e: ExportedController) -> tuple[str, str]:
    """Return the names of an update's input and answer."""
    return ("sample", "terms") if e.bare else ("reading", "output")


def _update_head(e: ExportedController) -> str:
    given, answer = _names(e)
    records = e.program.c_type(e.input_type), e.program.c_type(e.output_type)
    takes = f"const {records[0]} *{given}, {records[1]} *{answer}"
    return f"void {e.name}_update({e.name}_Controller *controller, {takes})"


def _public(e: ExportedController) -> str:
    """Return the functions of the interface: they hand parts of the controller to what was translated."""
    n, p, state = e.name, e.program, "controller->state"
    given, answer = _names(e)
    bodies = {f"void {n}_reset({n}_Controller *controller)": ["*controller = INITIAL;"]}
    memory = f"{state}.memory" if e.bare else state
    last = [given, "&controller->constants", "&SETTINGS"]
    if not e.bare:
        last[1:] = ["&SETTINGS", "&controller->constants"]
    bodies[_update_head(e)] = [
        f"const {p.c_type(e.update.result)} next = {e.update.name}(&{', '.join([memory, *last])});",
        f"{memory} = next.item0;",
        f"*{answer} = next.item1;",
    ]
    if e.bare:
        keeps = [f"if (!{answer}->held) {{", f"    {state}.sample = *{given};", "}"]
        bodies[_update_head(e)] += keeps
    else:
        activate, deactivate = f"&{state}, &SETTINGS.initial", f"&{state}"
        for f, turn, takes in (
            (e.activate, "activate", activate),
            (e.deactivate, "deactivate", deactivate),
        ):
            head = f"void {n}_{turn}({n}_Controller *controller)"
            bodies[head] = [f"{state} = {f.name}({takes});"]
    widened = "*wide += (uint32_t)(count - (uint32_t)*wide)"
    bodies[f"int64_t {n}_widened(int64_t *wide, uint32_t count)"] = [f"return {widened};"]
    parts = ["\n".join([f"{head} {{", *indented(body), "}\n"]) for head, body in bodies.items()]
    return "\n".join([*parts, *([_tuning(e)] if e.leaves else []), _self_test(e)])


def _tuning(e: ExportedController) -> str:
    limits = "SETTINGS" if e.bare else "SETTINGS.limits"
    given = [f"parameters->{leaf.name}" for leaf in e.leaves]
    pairs = list(zip(given, e.leaves, strict=True))
    return filled(
        "tuning.c",
        e,
        reads="\n".join(f"    {p} = controller->constants{leaf.place};" for p, leaf in pairs),
        checks="\n".join(f"    sound = sound && {check};" for check in _checks(e)),
        writes="\n".join(f"    after{leaf.place} = {p};" for p, leaf in pairs),
        constants=e.program.c_type(e.constants_type),
        retune=f"{e.retune.name}(&controller->state, &controller->constants, &after, &{limits})",
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
    """Return the statements of `fill` for cells in a row of bytes as `replay.packed` writes it."""
    kinds = {"double": "real_at({})", "int64_t": "integer_at({})", "bool": "integer_at({}) != 0"}
    places = enumerate(CELLS.items())
    cells = {name: kinds[kind].format(f"bytes + {8 * i}") for i, (name, kind) in places}
    return fill(e, cells, 2)


def fill(e: ExportedController, cells: Mapping[str, str], depth: int) -> str:
    """Return statements that make an update's input of these `CELLS`, update, and leave the ``effort``."""
    given, answer = _names(e)
    fields = {name.replace("hip_", "hip."): cells[name] for name in CELLS}
    if e.bare:
        dt = real_literal(seconds(e.config.period_ns))
        names = {"reference": "reference", "measurement": "position", "rate": "velocity"}
        fields = {
            **{name: cells[cell] for name, cell in names.items()},
            "dt": dt,
            "hip.position": cells["hip_position"],
            "hip.velocity": cells["hip_velocity"],
        }
    lines = [
        f"{e.program.c_type(e.input_type)} {given};",
        *(f"{given}.{name} = {cell};" for name, cell in fields.items()),
        f"{e.program.c_type(e.output_type)} {answer};",
        f"{e.name}_update(&controller, &{given}, &{answer});",
        f"const double effort = {answer}.effort;",
    ]
    return "\n".join(f"{'    ' * depth}{line}" for line in lines)
