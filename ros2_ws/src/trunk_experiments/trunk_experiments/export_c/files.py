"""All files of an exported controller, as texts by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from .constants import definition
from .controller import ExportedController, ExportedStep
from .replay import MAGIC, packed
from .source import fill, header, source

_IN_ARDUINO = 200  # rows, so that they fit into its flash
ROW_BYTES = 80


def base_files(e: ExportedController, rows: Sequence[ExportedStep]) -> dict[str, bytes]:
    """Return header, source, replay.c and its states."""
    at = {name: f"bytes + {8 * i}" for i, name in enumerate(_CELLS)}
    cells = {
        name: f"{'integer' if name in ('stamp_ns', 'has_reference') else 'real'}_at({place})"
        for name, place in at.items()
    }
    cells["has_reference"] += " != 0"
    replay = _filled(
        "replay.c",
        e,
        row_bytes=str(ROW_BYTES),
        magic=str(MAGIC),
        fill=fill(e, cells, 2),
    )
    return {
        f"{e.name}.h": header(e).encode(),
        f"{e.name}.c": source(e).encode(),
        "replay.c": replay,
        f"{e.name}.states": packed(rows),
    }


_CELLS = (
    "stamp_ns",
    "position",
    "velocity",
    "hip_position",
    "hip_velocity",
    "effort",
    "has_reference",
    "reference",
)


def cmake_files(e: ExportedController) -> dict[str, bytes]:
    """Return CMakeLists.txt."""
    return {"CMakeLists.txt": _filled("CMakeLists.txt", e)}


def arduino_files(
    e: ExportedController, rows: Sequence[ExportedStep], origin: str
) -> dict[str, bytes]:
    """Return an Arduino library with a sketch that says whether all commands are equal."""
    rows = rows[:_IN_ARDUINO]
    cells = {name: f"rows[i].{name}" for name in _CELLS}
    sketch = _filled(
        "arduino/equal.ino", e, rows=str(len(rows)), origin=origin, fill=fill(e, cells, 2)
    )
    library = f"arduino/{e.name}"
    return {
        f"{library}/library.properties": _filled("arduino/library.properties", e),
        f"{library}/src/{e.name}.h": header(e).encode(),
        f"{library}/src/{e.name}.c": source(e).encode(),
        f"{library}/examples/equal/equal.ino": sketch,
        f"{library}/examples/equal/rows.h": _rows_header(rows).encode(),
    }


def _rows_header(rows: Sequence[ExportedStep]) -> str:
    lines = []
    for row in rows:
        r = row.reading
        reals = [r.position, r.velocity, r.hip.position, r.hip.velocity, r.effort]
        flags = ["true" if r.has_reference else "false", definition(r.reference)]
        compared = "true" if row.compared else "false"
        cells = [
            f"INT64_C({r.stamp_ns})",
            *map(definition, reals),
            *flags,
            definition(row.effort),
            compared,
        ]
        lines.append(f"    {{{', '.join(cells)}}},")
    table = "\n".join(lines)
    return f"""// States, and the commands that answer them.
#ifndef NOT_A_NUMBER
#define NOT_A_NUMBER __builtin_nan("")
#define INFINITE __builtin_inf()
#endif
#define ROWS {len(rows)}
static const struct {{
    int64_t stamp_ns;
    double position, velocity, hip_position, hip_velocity, effort;
    bool has_reference;
    double reference, expected;
    bool compared;
}} rows[ROWS] = {{
{table}
}};
"""


def ros2_control_files(e: ExportedController) -> dict[str, bytes]:
    """Return a package with a plug-in for ros2_control."""
    folder, n = f"{e.name}_controller", e.name
    joints = ['params_.joint + "/position"', 'params_.joint + "/velocity"']
    hip = ""
    if e.config.hip is not None:
        joints += ['params_.hip_joint + "/position"', 'params_.hip_joint + "/velocity"']
        hip = "".join(
            f"    reading.hip.{name} = state_interfaces_[{i}].get_value();\n"
            for i, name in ((2, "position"), (3, "velocity"))
        )
    retune = "    return true;\n"
    if e.leaves:
        sets = "".join(
            f"    parameters.{leaf.name} = params_.{leaf.declaration.name};\n" for leaf in e.leaves
        )
        retune = f"    {n}_Parameters parameters;\n{sets}    return {n}_retune(&controller_, &parameters);\n"
    values = {"states": ", ".join(joints), "hip": hip, "retune": retune}
    return {
        f"{folder}/package.xml": _filled("ros2_control/package.xml", e),
        f"{folder}/CMakeLists.txt": _filled("ros2_control/CMakeLists.txt", e),
        f"{folder}/{folder}.xml": _filled("ros2_control/plugin.xml", e),
        f"{folder}/{folder}.hpp": _filled("ros2_control/controller.hpp", e),
        f"{folder}/{folder}.cpp": _filled("ros2_control/controller.cpp", e, **values),
        f"{folder}/{folder}_parameters.yaml": _parameters(e).encode(),
        f"{folder}/{n}.h": header(e).encode(),
        f"{folder}/{n}.c": source(e).encode(),
    }


def _parameters(e: ExportedController) -> str:
    """Return the parameters as generate_parameter_library reads them."""
    tree: dict[str, object] = {"joint": _entry("string", f'"{e.config.joint}"', "The joint", True)}
    if e.config.hip is not None:
        tree["hip_joint"] = _entry("string", f'"{e.config.hip}"', "The hip's joint", True)
    for leaf in e.leaves:
        declared = leaf.declaration
        place = tree
        *groups, last = declared.name.split(".")
        for group in groups:
            inner: Any = place.setdefault(group, {})
            place = inner
        unit = f" [{declared.unit}]" if declared.unit else ""
        text = f"{declared.description}{unit}".replace('"', "'")
        entry = _entry("double", repr(e.values[declared.name]), text, False)
        bounds = _bounds(declared.minimum, declared.above, declared.maximum)
        place[last] = {**entry, **({"validation": bounds} if bounds else {})}
    lines = [f"{e.name}_controller:", *_yaml(tree, 1)]
    return "\n".join(lines) + "\n"


def _entry(kind: str, default: str, text: str, fixed: bool) -> dict[str, object]:
    entry: dict[str, object] = {"type": kind, "default_value": default, "description": f'"{text}"'}
    return {**entry, "read_only": "true"} if fixed else entry


def _bounds(low: float | None, above: float | None, high: float | None) -> dict[str, object]:
    bounds: dict[str, object] = {}
    if low is not None:
        bounds["gt_eq<>"] = f"[{low!r}]"
    if above is not None:
        bounds["gt<>"] = f"[{above!r}]"
    if high is not None:
        bounds["lt_eq<>"] = f"[{high!r}]"
    return bounds


def _yaml(tree: Mapping[str, object], depth: int) -> list[str]:
    lines = []
    for key, value in tree.items():
        if isinstance(value, Mapping):
            lines += [f"{'  ' * depth}{key}:", *_yaml(value, depth + 1)]
        else:
            lines.append(f"{'  ' * depth}{key}: {value}")
    return lines


def _filled(template: str, e: ExportedController, **values: str) -> bytes:
    text = (Path(str(files(__package__))) / "templates" / f"{template}.in").read_text("utf-8")
    about = {"name": e.name, "NAME": e.name.upper(), "label": e.law.label, "digest": e.digest}
    return Template(text).substitute(about, licence=e.licence, **values).encode()
