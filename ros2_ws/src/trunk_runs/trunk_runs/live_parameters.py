"""What a parameter file would change in a running node. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

from trunk_core.errors import PlanError
from trunk_core.parameters.csv_files import numbers_for
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    declarations,
    of_every_node,
    table_of,
    tables_of,
    unknown_name,
    with_cells,
)
from trunk_core.parameters.parameter_files import Layer, ParameterFileError, resolve
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.parameters.to_si import to_si, written_with_units
from trunk_core.yaml_text import on_one_line


class LiveChange(NamedTuple):
    """A parameter to which a file gives another value than the node has."""

    name: str
    old: object
    new: object
    fixed: Annotated[bool, "Only at start"]

    def __str__(self) -> str:
        mark = " (fixed at start)" if self.fixed else ""
        return f"{self.name}: {on_one_line(self.old)} -> {on_one_line(self.new)}{mark}"


def full_name(node: str, namespace: str = "") -> str:
    """Return a node's fully qualified name, from that or from one relative to a namespace (``/robot1``).

    Raises PlanError for an absolute name with a namespace.
    """
    if namespace and node.startswith("/"):
        raise PlanError(f"{node} with --namespace {namespace}: give {node.rpartition('/')[2]}")
    return f"{namespace}/{node.strip('/')}"


def said_of(node: str, layer: Layer, declared: Sequence[str]) -> dict[str, object]:
    """Return a file's values for a node (fully qualified name) that declares these parameters.

    Raises ParameterFileError if no section applies to the node, and for an undeclared name in a section
    that names the node; a wildcard section may be meant for other nodes.
    """
    sections = [section for section in layer.sections if section.matches(node)]
    if not sections:
        there = ", ".join(section.pattern for section in layer.sections)
        raise ParameterFileError(f"{layer.source}: nothing for {node} in it; it is for {there}")
    for section in sections:
        for name in section.values if "*" not in section.last_token else ():
            if name not in declared and not table_of(name, declared) and not of_every_node(name):
                raise ParameterFileError(
                    f"{layer.source}: {section.pattern}: parameter {name!r}: "
                    f"{unknown_name(name, declared)}"
                )
    return resolve(node, [layer], declared)


def class_of(
    node: str, declared: Sequence[str], values: Callable[[Sequence[str]], Mapping[str, object]]
) -> type[Any] | None:
    """Return the class of the parameters of a node with one of the project's names; None for another.

    ``declared``: the names that it declares. Raises as `config_class` does.
    """
    from .nodes import NODES, config_class

    name = node.rsplit("/", 1)[-1]
    if name not in NODES:
        return None
    return config_class(name, values([PLANT_NAME]) if PLANT_NAME in declared else {})


def planned_names(config: type[Any] | None) -> list[str]:
    """Return the keys that trunk reads for a node: those of CSV files."""
    return [] if config is None else [table.key.name for table in tables_of(config)]


def with_numbers(
    node: str,
    config: type[Any] | None,
    layer: Layer,
    said: Mapping[str, object],
    values: Callable[[Sequence[str]], Mapping[str, object]],
) -> dict[str, object]:
    """Return a layer's values for a node with the numbers of the CSV files that it names.

    ``values`` returns what the node has for some names. Raises ParameterFileError.
    """
    planned = planned_names(config)
    if config is None or said.keys().isdisjoint(planned):
        return dict(said)
    declared = declarations(config)
    choosers = [declared[f"{table.prefix}.values"].unit_by for table in tables_of(config)]
    numbers = numbers_for(node, [layer], config, values(list(filter(None, choosers)))).values
    return {name: value for name, value in said.items() if name not in planned} | {
        name: list(value) if isinstance(value, tuple) else value for name, value in numbers.items()
    }


def with_tables(
    node: str,
    config: type[Any] | None,
    source: str,
    said: Mapping[str, object],
    values: Callable[[Sequence[str]], Mapping[str, Any]],
) -> dict[str, object]:
    """Return a layer's values for a node with changed tables in place of cells.

    ``values`` returns the node's values of some names. Raises ParameterFileError for a cell that is not
    there.
    """
    if config is None or not any(table_of(name, declarations(config)) for name in said):
        return dict(said)
    present = values([name for name in declarations(config) if name not in said])
    try:
        changed = with_cells(config, said, lambda: present)
    except ParameterError as error:
        raise ParameterFileError(f"{source}: {node}: {error}") from None
    return {name: list(v) if isinstance(v, tuple) else v for name, v in changed.items()}


def choosers_of(config: type[Any] | None, said: Mapping[str, object]) -> list[str]:
    """Return the parameters of a node that choose the units of those that a file sets with units."""
    if not _have_text(said):  # the usual case: nothing to look up
        return []
    declared = _declared(config)
    written = written_with_units(declared, said)
    chosen = (declared[name].unit_by for name in said if name in written)
    return list(dict.fromkeys(filter(None, chosen)))


def said_in_si(
    node: str,
    config: type[Any] | None,
    source: str,
    said: Mapping[str, object],
    present: Mapping[str, object],
) -> dict[str, object]:
    """Return a file's values with numbers that have units in SI units.

    This applies to nodes with one of the project's names; other nodes check their values themselves.
    ``present``: the node's values, including those that `choosers_of` names. Raises ParameterFileError for a
    unit that does not fit.
    """
    if not _have_text(said):
        return dict(said)
    try:
        return to_si(_declared(config), said, present)
    except ParameterError as error:
        raise ParameterFileError(f"{source}: {node}: {error}") from None


def _have_text(said: Mapping[str, object]) -> bool:
    """Return True if a value is or contains text, which may be a number with a unit."""
    return any(
        isinstance(item, str)
        for value in said.values()
        for item in (value if isinstance(value, list | tuple) else [value])
    )


def _declared(config: type[Any] | None) -> Mapping[str, Declaration]:
    return {} if config is None else declarations(config)


def differences(
    said: Mapping[str, object], present: Mapping[str, object], fixed: Iterable[str]
) -> list[LiveChange]:
    """Return the parameters whose value in the file differs from the node's; integers pass for doubles."""
    unchangeable = set(fixed)
    changes = []
    for name, value in said.items():
        old, new = present[name], as_present(value, present[name])
        if new != old or type(new) is not type(old):
            changes.append(LiveChange(name, old, new, name in unchangeable))
    return changes


def as_present(value: object, present: object) -> object:
    """Return a number as a float if the current value is one; the node judges any other type."""
    if isinstance(present, float) and type(value) is int:
        return _as_float(value)
    if isinstance(value, list) and isinstance(present, list):
        floats = all(isinstance(item, float) for item in present)
        if floats and all(type(item) in (int, float) for item in value):
            return [_as_float(item) for item in value]
    return value


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return float("inf")
