"""One node's configuration from the layers of files and single values; units and CSV become numbers here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from trunk_msgs_util.parameters.csv_files import numbers_for
from trunk_msgs_util.parameters.declarations import ParameterError, build, declarations, table_of
from trunk_msgs_util.parameters.files import Layer, ParameterFileError, resolve
from trunk_msgs_util.parameters.to_si import to_si, written_with_units

from .nodes import NODES


class Resolved(NamedTuple):
    """A node's configuration, and the parameters in whose values a unit is written."""

    config: Any
    with_units: set[str]


def config_from(node: str, layers: Sequence[Layer], namespace: str) -> Resolved:
    """Return a node's configuration, the CSV files that the layers name read.

    Raises ParameterFileError naming the layer of a wrong value.
    """
    config = NODES[node].config
    full_name = f"{namespace}/{node}"
    declared = declarations(config)
    of_files = numbers_for(full_name, layers, config)
    values = resolve(full_name, layers, declared) | of_files.values
    try:
        return Resolved(
            build(config, to_si(declared, values)),
            written_with_units(declared, values) | of_files.with_units,
        )
    except ParameterError as error:
        source = _source(full_name, error.name, layers)
        note = ""
        if error.name in written_with_units(declared, values):
            note = _written(values[error.name], error)
        raise ParameterFileError(f"{source}: {node}: {error}{note}") from None


def _source(node: str, name: str, layers: Sequence[Layer]) -> str:
    """Return the layer that gave a node its value of a parameter."""
    for layer in reversed(layers):
        if any(
            s.matches(node) and any(key == name or table_of(key, {name}) for key in s.values)
            for s in layer.sections
        ):
            return layer.source
    return "defaults"


def _written(value: object, error: ParameterError) -> str:
    """Return the value as the file has it, where the error shows it in SI units."""
    text = str(value)
    if isinstance(error.value, str) and error.value in text:
        return ""
    return f" (written {text if len(text) <= 60 else text[:57] + '...'})"
