"""The units in which a study's entry may write its numbers: those of the parameters that it varies."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from math import degrees
from typing import Any

from trunk_msgs_util.parameters.declarations import (
    UnitError,
    declarations,
    looks_like_quantity,
    values_of,
)
from trunk_msgs_util.parameters.to_si import read_quantity, units_of

from ..plans.nodes import NODES
from .study import ContenderSpec, StudySpec, Target, Variable
from .targets import node_of

_UNIT = re.compile(r"[-+.\d]+(?:[eE][-+]?\d+)?\s*(\D.*)")
Units = tuple[tuple[str, ...], ...]  # a number has to fit each inner tuple, by any one of its units


def units_for(targets: Sequence[Target], how: str, contenders: Sequence[ContenderSpec]) -> Units:
    """Return the units of an entry's numbers; none where a parameter is no double.

    A factor has no unit. Which unit counts where another parameter chooses it, `check_units` says.
    """
    units: dict[tuple[str, ...], None] = {}
    for target in targets:
        for node in {node_of(target, contender): None for contender in contenders}:
            declared = declarations(NODES[node].config).get(target.name)
            if declared is None:  # refused later, by name
                continue
            if not declared.kind.startswith("double"):
                return ()
            elements = units_of(declared)
            units[elements[min(target.index or 0, len(elements) - 1)]] = None
    return (("",),) if how == "factor" else tuple(units)


def written_in(entry: Mapping[str, object]) -> tuple[str, ...]:
    """Return the numbers with units in an entry's values, as written."""
    items = [
        item for value in entry.values() for item in (value if isinstance(value, list) else [value])
    ]
    return tuple(item for item in items if isinstance(item, str) and looks_like_quantity(item))


def number_of(text: str, units: Units) -> float:
    """Return a number with a unit in SI units. Raises UnitError unless it fits all of ``units``."""
    numbers = [read_quantity(text, *allowed) for allowed in units]
    return numbers[0]


def shown_unit(study: StudySpec, v: Variable) -> tuple[str, float]:
    """Return the unit in which a variable's numbers are shown, and what its SI numbers are multiplied by.

    It is the one of the entry's first number that has one, else the parameter's, angles in degrees; empty
    where several are possible.
    """
    if v.how == "factor":
        return "factor", 1.0
    allowed = {unit for units in units_for(v.targets, v.how, study.contenders) for unit in units}
    if len(allowed) > 1:  # another parameter chooses
        chosen = {unit for target in v.targets for unit in _chosen(study, target)}
        allowed = chosen if len(chosen) == 1 else allowed
    typed = _UNIT.sub(r"\1", v.written[0]) if v.written else ""
    for unit in allowed if typed else ():
        with suppress(UnitError):
            scale = 1.0 / read_quantity(f"1 {typed}", unit)
            return (unit if scale == 1.0 else "°" if unit == "rad" else typed), scale
    if allowed == {"rad"}:
        return "°", degrees(1.0)
    return (min(allowed), 1.0) if len(allowed) == 1 else ("", 1.0)


def shown(study: StudySpec, name: str, value: object) -> str:
    """Return one of a study's numbers with the unit in which it is shown; anything else as it is."""
    if not isinstance(value, float | int) or isinstance(value, bool):
        return str(value)
    unit, scale = shown_unit(study, next(v for v in study.variables if v.name == name))
    number = f"{value * scale:.6g}"
    return number + unit if unit == "°" else f"{number} {unit}".replace(" factor", " times").strip()


def _chosen(study: StudySpec, target: Target) -> Iterable[str]:
    """Yield the unit that a study's own settings choose for a parameter."""
    declared = (
        declarations(NODES[target.node].config).get(target.name) if target.node in NODES else None
    )
    for text in study.settings if declared and declared.unit_by else ():
        name, _, value = text.partition("=")
        if declared and name == f"{target.node}.{declared.unit_by}":
            yield from units_of(declared, {declared.unit_by: value})[0]


def check_units(study: StudySpec, v: Variable, target: Target, config: Any) -> None:
    """Check an entry's units where another parameter of the node chooses the unit. Raises UnitError."""
    declared = declarations(type(config)).get(target.name)
    if declared is None or not declared.unit_by or v.how == "factor":
        return
    for chosen in _values_of(study, Target(target.node, declared.unit_by), config):
        (allowed,) = units_of(declared, {declared.unit_by: chosen})
        for text in v.written:
            try:
                read_quantity(text, *allowed)
            except UnitError as error:
                raise UnitError(
                    f"{text!r} is not allowed where {declared.unit_by} is {chosen}: {error}"
                ) from None


def _values_of(study: StudySpec, target: Target, config: Any) -> Iterable[object]:
    """Return all values that a parameter has in a study's runs."""
    for v in study.variables:
        if target in v.targets:
            return v.values if v.distribution is None else v.distribution.values
    return (values_of(config)[target.name],)
