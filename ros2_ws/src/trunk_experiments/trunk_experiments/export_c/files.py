"""All files of an exported controller, as texts by their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isfinite
from typing import Any

import yaml

from ..errors import PlanError
from .constants import definition
from .controller import CELLS, ExportedController, ExportedStep
from .program import RESERVED
from .replay import MAGIC, packed
from .source import fill, fill_from_bytes, filled, header, source

_IN_ARDUINO = 200  # rows, so that they fit into its flash
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
    """Return header, source, replay.c and its states."""
    values = {"row_bytes": ROW_BYTES, "magic": MAGIC, "fill": fill_from_bytes(e)}
    return {
        **_pair(e),
        "replay.c": filled("replay.c", e, **values).encode(),
        f"{e.name}.states": packed(rows),
    }


def _pair(e: ExportedController, folder: str = "") -> dict[str, bytes]:
    """Return header and source, in a folder."""
    pair = {"h": header(e), "c": source(e)}
    return {f"{folder}{e.name}.{suffix}": text.encode() for suffix, text in pair.items()}


def cmake_files(e: ExportedController) -> dict[str, bytes]:
    """Return CMakeLists.txt."""
    return {"CMakeLists.txt": filled("CMakeLists.txt", e).encode()}


def arduino_files(
    e: ExportedController, rows: Sequence[ExportedStep], origin: str
) -> dict[str, bytes]:
    """Return an Arduino library with a sketch that says whether all commands are equal."""
    rows = rows[:_IN_ARDUINO]
    library = f"arduino/{e.name}"
    cells = {name: f"rows[i].{name}" for name in CELLS}
    values = {"rows": len(rows), "origin": origin, "fill": fill(e, cells, 2)}
    table = "\n".join(
        f"    {{{', '.join(map(_cell, (*row.numbers, row.compared)))}}}," for row in rows
    )
    texts = {
        "library.properties": filled("arduino/library.properties", e),
        "examples/equal/equal.ino": filled("arduino/equal.ino", e, **values),
        "examples/equal/rows.h": filled("arduino/rows.h", e, rows=len(rows), table=table),
    }
    return {
        **_pair(e, f"{library}/src/"),
        **{f"{library}/{name}": text.encode() for name, text in texts.items()},
    }


def _cell(number: int | float) -> str:
    if isinstance(number, bool):
        return "true" if number else "false"
    if isinstance(number, int):
        return f"INT64_C({number})"
    return f"{number.hex()}L" if isfinite(number) else definition(number)


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
    files = {"package.xml": "package.xml", "CMakeLists.txt": "CMakeLists.txt"}
    files |= {f"{folder}.{suffix}": f"controller.{suffix}" for suffix in ("hpp", "cpp")}
    files |= {f"{folder}.xml": "plugin.xml"}
    texts = {name: filled(f"ros2_control/{file}", e, **values) for name, file in files.items()}
    texts[f"{folder}_parameters.yaml"] = _parameters(e)
    return {
        **_pair(e, f"{folder}/"),
        **{f"{folder}/{name}": text.encode() for name, text in texts.items()},
    }


def _parameters(e: ExportedController) -> str:
    """Return the parameters as generate_parameter_library reads them."""
    fixed: dict[str, Any] = {"type": "string", "read_only": True}
    tree = {"joint": fixed | {"default_value": e.config.joint, "description": "The joint"}}
    if e.config.hip is not None:
        tree["hip_joint"] = fixed | {
            "default_value": e.config.hip,
            "description": "The hip's joint",
        }
    for leaf in e.leaves:
        declared = leaf.declaration
        *groups, last = declared.name.split(".")
        place = tree
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = {
            "type": "double",
            "default_value": float(e.values[declared.name]),
            "description": f"{declared.description}{f' [{declared.unit}]' if declared.unit else ''}",
        }
        bounds = {"gt_eq<>": declared.minimum, "gt<>": declared.above, "lt_eq<>": declared.maximum}
        if given := {name: [float(bound)] for name, bound in bounds.items() if bound is not None}:
            place[last]["validation"] = given
    dumped: str = yaml.safe_dump({f"{e.name}_controller": tree}, sort_keys=False, width=100)
    return dumped
