"""Parameters that are numbers in a law's constants: those that can change on the target."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

from trunk_control.controller_config import ControllerConfig
from trunk_msgs_util.parameters.declarations import (
    Declaration,
    ParameterError,
    build,
    declarations,
    values_of,
)

from .program import Definitions
from .types import REAL, RecordType, Type

_FACTORS = (1.0009765625, 0.9990234375, 1.0732421875, 0.8798828125)


class Leaf(NamedTuple):
    """A parameter that is a number of the constants: its declaration, its name and its place in C."""

    declaration: Declaration
    name: str
    place: str  # behind the constants


def places_of(program: Definitions, t: Type, place: str = "") -> Iterator[str]:
    """Yield the places of the doubles of a type, without those in tables."""
    if isinstance(t, RecordType):
        for i, inner in enumerate(t.types):
            yield from places_of(program, inner, f"{place}.{program.field(t, i)}")
    elif t == REAL:
        yield place


def leaves_of(config: ControllerConfig, program: Definitions, t: Type) -> list[Leaf]:
    """Return the parameters that may change while the controller runs and are one number of its constants.

    Each is tried with other values: exactly that number takes the value, bit by bit, and all else keeps its
    bits.
    """
    places = list(places_of(program, t))
    before = list(_numbers(config.constants, t))
    leaves = []
    for name, declared in declarations(type(config)).items():
        if declared.fixed or declared.kind != "double":
            continue
        where = {_place_of(config, name, factor, t, before) for factor in _FACTORS} - {None}
        if len(where) == 1 and (k := where.pop()) is not None and k >= 0:
            leaves.append(Leaf(declared, name.replace(".", "_"), places[k]))
    return leaves


def _place_of(
    config: ControllerConfig, name: str, factor: float, t: Type, before: list[Any]
) -> int | None:
    """Return the number that a parameter is; -1 if it is none, None if the value is not allowed."""
    values = values_of(config)
    value = float(values[name]) * factor or 0.001953125 * factor  # type: ignore[arg-type]
    try:
        other = build(type(config), {**values, name: value})
    except ParameterError:
        return None
    after = list(_numbers(other.constants, t))
    if len(after) != len(before):
        return -1
    changed = [i for i, (a, b) in enumerate(zip(before, after, strict=True)) if a != b]
    if len(changed) != 1 or after[changed[0]] != struct.pack("<d", value):
        return -1
    in_tables = [a for a in after[: changed[0]] if not isinstance(a, bytes)]
    return changed[0] - len(in_tables)


def _numbers(value: Any, t: Type) -> Iterator[Any]:
    """Yield the bits of the doubles of a value; everything else as it is."""
    if isinstance(t, RecordType):
        for item, inner in zip(value, t.types, strict=True):
            yield from _numbers(item, inner)
    elif t == REAL:
        yield struct.pack("<d", value)
    else:
        yield repr(value)
