"""The numbers of the CSV files that parameter files name (`table_keys`), for a plan or a running node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from .csv_table import Column, read_csv
from .declarations import ParameterError, check, declarations
from .files import Layer, ParameterFileError
from .in_si import units_of
from .table_keys import FILE, TableFile, tables_of


class Numbers(NamedTuple):
    """Values that a node's CSV files give, by parameter, and which of them were written with a unit."""

    values: dict[str, object]
    with_units: set[str]


class _Said(NamedTuple):
    value: object
    place: int  # a later one wins
    layer: Layer


def numbers_for(
    node: str,
    layers: Sequence[Layer],
    config: type[Any],
    present: Mapping[str, object] | None = None,
) -> Numbers:
    """Return the numbers of the CSV files that the layers name for a node (fully qualified name).

    ``present``: a running node's values of parameters that choose a unit, in place of the defaults.
    Raises ParameterFileError for a file that cannot be used, keys whose switch is not "file" or the
    reverse, and numbers given besides a file. What a later layer sets wins.
    """
    numbers = Numbers({}, set())
    said: dict[str, _Said] | None = None
    for table in tables_of(config):
        names = {one.name for one in table.keys} | ({table.switch} - {""})
        if not any(names & s.values.keys() for layer in layers for s in layer.sections):
            continue
        said = _said(node, layers) if said is None else said
        if _counts(table, said, node):
            _fill(numbers, table, said, node, config, present or {})
    return numbers


def _said(node: str, layers: Sequence[Layer]) -> dict[str, _Said]:
    sections = [(layer, section) for layer in layers for section in layer.sections]
    return {
        name: _Said(value, place, layer)
        for place, (layer, section) in enumerate(sections)
        if section.matches(node)
        for name, value in section.values.items()
    }


def _counts(table: TableFile, said: Mapping[str, _Said], node: str) -> bool:
    """Return True if a file is named and is to be used."""
    key = said.get(table.key.name)
    named = key is not None and key.value != ""
    switch = said.get(table.switch)
    if not table.switch:
        return named
    if switch is not None and switch.value == FILE:
        if not named:
            raise _refused(
                switch, node, table.switch, f"with it, {table.key.name} must name a CSV file"
            )
        return True
    for name in (one.name for one in table.keys):
        one = said.get(name)
        if one is None or one.value == "":
            continue
        if switch is None or switch.place <= one.place:  # else a later layer overrides it
            raise _refused(one, node, name, f"it is used only with {table.switch}: {FILE}")
    return False


def _fill(
    numbers: Numbers,
    table: TableFile,
    said: Mapping[str, _Said],
    node: str,
    config: type[Any],
    present: Mapping[str, object],
) -> None:
    key, name = said[table.key.name], table.key.name
    if not isinstance(key.value, str | PathLike):
        raise _refused(key, node, name, "a string is needed, the path of a CSV file")
    for other in (table.times, table.values):
        if other in said and said[other].place >= key.place:
            raise _refused(
                said[other], node, other, f"{name} gives the numbers: give only one of the two"
            )
    declared = declarations(config)
    defaults = {one.name: one.default for one in declared.values()}
    chosen = {**defaults, **present, **{name: one.value for name, one in said.items()}}
    columns = [
        Column(heading, declared[target], units_of(declared[target], chosen)[0][0])
        for heading, target in (("t", table.times), (table.column, table.values))
    ]
    try:
        (times, values), with_unit = read_csv(key.layer.folder / Path(key.value), columns)
    except ParameterFileError as error:
        raise ParameterFileError(f"{key.layer.source}: {_short(node)}: {name}: {error}") from None
    numbers.values.update({table.times: times, table.values: values})
    numbers.with_units.update({table.values} if with_unit[1] else ())
    if table.interpolation is not None:
        how = said.get(table.interpolation.name)
        kind = table.interpolation.default if how is None else how.value
        try:
            numbers.values[table.switch] = dict(table.becomes)[
                str(check(table.interpolation, kind))
            ]
        except ParameterError as error:
            assert how is not None
            raise ParameterFileError(f"{how.layer.source}: {_short(node)}: {error}") from None


def _refused(one: _Said, node: str, name: str, allowed: str) -> ParameterFileError:
    error = ParameterError(name, one.value, allowed)
    return ParameterFileError(f"{one.layer.source}: {_short(node)}: {error}")


def _short(node: str) -> str:
    return node.rpartition("/")[2]
