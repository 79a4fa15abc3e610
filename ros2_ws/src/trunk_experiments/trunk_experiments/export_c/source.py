"""The header and the source of an exported controller."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from math import inf

from trunk_msgs_util.provenance import ARITHMETIC

from .constants import definition, real_literal
from .controller import ExportedController, ExportedStep
from .emit import ARITHMETIC as PRELUDE
from .emit import INCLUDES
from .program import Translated
from .types import RecordType, Type

# What NAME_self_test() returns.
FAULTS = ("SOUND", "CONTRACTED", "EXTENDED", "ROUNDED", "FLUSHED", "DIFFERENT")


def heading(e: ExportedController, purpose: str) -> str:
    """Return the comment at the top of a file."""
    return f"""/* {e.law.label}: {purpose}.
 *
 * Written by trunk export-c {version("trunk_experiments")}; do not edit.
 * controller  {e.name} of {e.package}{" (the law alone)" if e.bare else ""}
 * parameters  {e.digest}
 * sources     {e.fingerprint}
 * arithmetic  {ARITHMETIC}
 * licence     {e.licence}
 */"""


def header(e: ExportedController) -> str:
    """Return NAME.h."""
    n, p = e.name, e.program
    guard = f"{n.upper()}_H"
    records = "\n\n".join(p.structure(record) for record in e.public_records)
    state, constants = p.c_type(e.state_type), p.c_type(e.constants_type)
    given, answer = p.c_type(e.input_type), p.c_type(e.output_type)
    parameters = "".join(
        f"    double {leaf.name}; /* {_about(leaf.declaration)} */\n" for leaf in e.leaves
    )
    retune = (
        f"""
/* Parameters that may change while the controller runs. */
typedef struct {{
{parameters}}} {n}_Parameters;
"""
        if e.leaves
        else ""
    )
    tuning = (
        f"""
/* The parameters in force. */
void {n}_parameters(const {n}_Controller *controller, {n}_Parameters *parameters);

/* New parameters; the command does not jump. False, and nothing changes, if one is out of its range; rules
 * that join several parameters are not checked here. */
bool {n}_retune({n}_Controller *controller, const {n}_Parameters *parameters);
"""
        if e.leaves
        else ""
    )
    turns = (
        ""
        if e.bare
        else f"""
/* Take the plant over, from the torque that acts; leave it to somebody else. */
void {n}_activate({n}_Controller *controller);
void {n}_deactivate({n}_Controller *controller);
"""
    )
    faults = "\n".join(f"#define {n.upper()}_{fault} {i}" for i, fault in enumerate(FAULTS))
    return f"""{heading(e, "its interface")}
#ifndef {guard}
#define {guard}

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

#define {n.upper()}_PERIOD_NS INT64_C({e.config.period_ns})

{records}

/* A controller's memory, and the constants in force. */
typedef struct {{
    {state} state;
    {constants} constants;
}} {n}_Controller;
{retune}
/* As new, with the parameters of the file. */
void {n}_reset({n}_Controller *controller);

/* The answer to a state. */
void {n}_update({n}_Controller *controller, const {given} *{_given(e)}, {answer} *{_answer(e)});
{turns}{tuning}
/* Whether compiler and processor give the bits that CPython gives; run it once, at the start. */
{faults}
int {n}_self_test(void);

#ifdef __cplusplus
}}
#endif
#endif
"""


def source(e: ExportedController) -> str:
    """Return NAME.c."""
    public = _public(e)
    settings = e.settings.limits if e.bare else e.settings
    kind = e.limits_type if e.bare else e.settings_type
    p = e.program
    statics = "\n\n".join(
        [
            f"static const {p.c_type(kind)} SETTINGS = {p.initial(settings, kind)};",
            f"""static const {e.name}_Controller INITIAL = {{
    {p.initial(e.initial, e.state_type, 2)},
    {p.initial(e.config.constants, e.constants_type, 2)},
}};""",
        ]
    )
    private = "\n\n".join(p.structure(record) for record in e.private_records)
    body = p.text(f"{statics}\n{public}")
    parts = [
        heading(e, "its functions, translated from Python"),
        f'#include "{e.name}.h"',
        INCLUDES,
        PRELUDE,
        *([private] if private else []),
        body,
        statics,
        public,
    ]
    return "\n\n".join(parts) + "\n"


def _given(e: ExportedController) -> str:
    return "sample" if e.bare else "reading"


def _answer(e: ExportedController) -> str:
    return "terms" if e.bare else "output"


def _about(declared: object) -> str:
    unit = getattr(declared, "unit", "")
    return f"{getattr(declared, 'name', '')}{f', {unit}' if unit else ''}"


def _public(e: ExportedController) -> str:
    n, p = e.name, e.program
    given = p.c_type(e.input_type)
    answer = p.c_type(e.output_type)
    if e.bare:
        assert isinstance(e.state_type, RecordType)
        arguments = ["sample", "&controller->constants", "&SETTINGS"]
        memory = e.state_type.types[0]
        update = _changed(e, e.update, arguments, ", terms", "state.memory", memory)
        update += """
    if (!terms->held) {
        controller->state.sample = *sample;
    }"""
    else:
        arguments = ["reading", "&SETTINGS", "&controller->constants"]
        update = _changed(e, e.update, arguments, ", output")
    parts = [
        f"""void {n}_reset({n}_Controller *controller) {{
    *controller = INITIAL;
}}""",
        f"""void {n}_update({n}_Controller *controller, const {given} *{_given(e)}, {answer} *{_answer(e)}) {{
{update}
}}""",
    ]
    if not e.bare:
        activate = _changed(e, e.activate, ["&SETTINGS.initial"])
        deactivate = _changed(e, e.deactivate, [])
        parts += [
            f"void {n}_activate({n}_Controller *controller) {{\n{activate}\n}}",
            f"void {n}_deactivate({n}_Controller *controller) {{\n{deactivate}\n}}",
        ]
    if e.leaves:
        parts += [_tuning(e)]
    return "\n\n".join([*parts, _self_test(e)])


def _changed(
    e: ExportedController,
    f: Translated,
    arguments: list[str],
    others: str = "",
    place: str = "state",
    t: Type | None = None,
) -> str:
    """Return the call of a function from a part of the controller to its next value, and to other outputs."""
    call = f"{f.name}({', '.join([f'&controller->{place}', *arguments])}"
    if f.in_place:
        return f"    {call}, &controller->{place}{others});"
    kind = e.program.c_type(t or e.state_type)
    return f"    {kind} next;\n    {call}, &next{others});\n    controller->{place} = next;"


def _tuning(e: ExportedController) -> str:
    n, p = e.name, e.program
    reads = "\n".join(
        f"    parameters->{leaf.name} = controller->constants{leaf.place};" for leaf in e.leaves
    )
    checks = "\n".join(
        f"    sound = sound && {_range(leaf.declaration, leaf.name)};" for leaf in e.leaves
    )
    writes = "\n".join(f"    after{leaf.place} = parameters->{leaf.name};" for leaf in e.leaves)
    limits = "SETTINGS" if e.bare else "SETTINGS.limits"
    arguments = ["&controller->constants", "&after", f"&{limits}"]
    return f"""void {n}_parameters(const {n}_Controller *controller, {n}_Parameters *parameters) {{
{reads}
}}

bool {n}_retune({n}_Controller *controller, const {n}_Parameters *parameters) {{
    bool sound = true;
{checks}
    if (!sound) {{
        return false;
    }}
    {p.c_type(e.constants_type)} after = controller->constants;
{writes}
{_changed(e, e.retune, arguments)}
    controller->constants = after;
    return true;
}}"""


def _range(declared: object, name: str) -> str:
    """Return the condition of a parameter's range; false for NaN."""
    terms = []
    value = f"parameters->{name}"
    for bound, sign in (("minimum", ">="), ("above", ">"), ("maximum", "<=")):
        limit = getattr(declared, bound)
        if limit is not None and abs(limit) < inf:
            terms.append(f"{value} {sign} {real_literal(float(limit))}")
    if not getattr(declared, "unbounded", False):
        terms.append(f"{value} - {value} == 0.0")
    return " && ".join(terms) or f"{value} == {value}"


def _self_test(e: ExportedController) -> str:
    n, rows = e.name, e.answers()
    columns = 7
    names = ("position", "velocity", "hip_position", "hip_velocity", "effort", "reference")
    cells = {name: f"row[{i}]" for i, name in enumerate(names)}
    cells |= {"stamp_ns": f"i * {n.upper()}_PERIOD_NS", "has_reference": "false"}
    table = "\n".join(
        f"        {{{', '.join(definition(v) for v in _cells(e, row))}}}," for row in rows
    )
    return f"""static double opaque(double x) {{
    volatile double y = x;
    return y;
}}

int {n}_self_test(void) {{
    static const double answers[{len(rows)}][{columns}] = {{
{table}
    }};
    const double a = opaque(1.0) + 0x1p-30, b = opaque(0x1p-53), least = opaque(DBL_MIN);
    if (a * a - opaque(0x1.0000000800000p+0) != 0.0) {{
        return {n.upper()}_CONTRACTED; /* a product and a sum in one rounding */
    }}
    if (opaque(1.0) + b + b != 1.0) {{
        return {n.upper()}_EXTENDED; /* sums of more than 53 bits, or in another order */
    }}
    if (opaque(1.0) + 0x1p-52 + b != 1.0 + 0x1p-51 || opaque(-1.0) - b != -1.0) {{
        return {n.upper()}_ROUNDED; /* not to the nearest, halves to even */
    }}
    if (least * 0.5 == 0.0 || opaque(0x0.0000000000001p-1022) * opaque(1.0) == 0.0) {{
        return {n.upper()}_FLUSHED; /* small numbers become 0 */
    }}
    {n}_Controller controller;
    {n}_reset(&controller);
    for (int i = 0; i < {len(rows)}; i++) {{
        const double *row = answers[i];
{fill(e, cells, 2)}
        const double expected = row[{columns - 1}];
        if (!(effort == expected || (effort != effort && expected != expected))) {{
            return {n.upper()}_DIFFERENT; /* from CPython's answer */
        }}
    }}
    return {n.upper()}_SOUND;
}}"""


def _cells(e: ExportedController, row: ExportedStep) -> list[float]:
    r = row.reading
    return [
        r.position,
        r.velocity,
        r.hip.position,
        r.hip.velocity,
        r.effort,
        r.reference,
        row.effort,
    ]


def fill(e: ExportedController, cells: Mapping[str, str], depth: int) -> str:
    """Return statements that make an update's input of these cells, update, and leave the ``effort``."""
    p, c = e.program, cells
    given, answer = p.c_type(e.input_type), p.c_type(e.output_type)
    if e.bare:
        first = e.answers(1)[0].reading
        lines = [
            f"{given} sample;",
            f"sample.reference = {c['reference']};",
            f"sample.measurement = {c['position']};",
            f"sample.rate = {c['velocity']};",
            f"sample.dt = {real_literal(e.sample(first).dt)};",
            f"sample.hip.position = {c['hip_position']};",
            f"sample.hip.velocity = {c['hip_velocity']};",
        ]
    else:
        lines = [
            f"{given} reading;",
            f"reading.stamp_ns = {c['stamp_ns']};",
            f"reading.position = {c['position']};",
            f"reading.velocity = {c['velocity']};",
            f"reading.hip.position = {c['hip_position']};",
            f"reading.hip.velocity = {c['hip_velocity']};",
            f"reading.effort = {c['effort']};",
            f"reading.has_reference = {c['has_reference']};",
            f"reading.reference = {c['reference']};",
        ]
    lines += [
        f"{answer} {_answer(e)};",
        f"{e.name}_update(&controller, &{_given(e)}, &{_answer(e)});",
        f"const double effort = {_answer(e)}.effort;",
    ]
    return "\n".join(f"{'    ' * depth}{line}" for line in lines)
