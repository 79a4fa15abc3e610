"""The units in which a study's entry may write its numbers: those of the parameters that it varies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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
