"""Parameters that are the rows of a table over time, and how a parameter file names a CSV in their place.

Plans read the keys that name one, and nodes do not have them. Nodes and recordings get the numbers, never a
path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from .declarations import Declaration, ParameterError, declarations, parameter

FILE = "file"  # the value of `TableFile.switch`
ONLY_PLANNED = "only trunk reads files: give the node the parameter file that trunk plan writes"


@dataclass(frozen=True)
class TableFile:
    """The keys with which a parameter file names a CSV, and the parameters that get its numbers.

    With a ``switch``, the CSV is used if that parameter is "file"; ``becomes`` says, for each value of
    ``interpolation``, what the switch becomes.
    """

    key: Declaration
    times: str
    values: str
    column: str  # the heading of the values
    switch: str = ""
    interpolation: Declaration | None = None
    becomes: tuple[tuple[str, str], ...] = ()

    @property
    def keys(self) -> tuple[Declaration, ...]:
        """What only plans read."""
        return (self.key,) if self.interpolation is None else (self.key, self.interpolation)


def tables_of(config: type[Any]) -> tuple[TableFile, ...]:
    """Return the CSV files that can be named for nodes of a configuration class."""
    tables: tuple[TableFile, ...] = getattr(config, "table_files", ())
    return tables


def listed(config: type[Any]) -> dict[str, Declaration]:
    """Return all keys of a parameter file: the node's declarations, and what only plans read."""
    switches = {table.switch for table in tables_of(config)}
    keys = {table.values: table.keys for table in tables_of(config)}
    declared: dict[str, Declaration] = {}
    for name, declaration in declarations(config).items():
        declared[name] = (
            replace(declaration, choices=(*declaration.choices, FILE))
            if name in switches
            else declaration
        )
        declared |= {key.name: key for key in keys.get(name, ())}
    return declared


def only_planned(config: type[Any], name: str) -> bool:
    """Return True for a key that plans read and nodes do not have."""
    return any(key.name == name for table in tables_of(config) for key in table.keys)


MOST_ROWS = 10_000


def times_parameter(name: str, description: str) -> Any:
    """Return the declaration of times in s, by default none."""
    return parameter(
        name,
        (),
        description,
        unit="s",
        element=float,
        longest=MOST_ROWS,
        minimum=0.0,
        maximum=1e6,
    )


def check_rows(prefix: str, times: Sequence[float], values: Sequence[float]) -> None:
    """Raise ParameterError unless ``PREFIX.values`` are as many as ``PREFIX.times``, which ascend."""
    if len(values) != len(times):
        raise ParameterError(
            f"{prefix}.values", values, f"as many as {prefix}.times ({len(times)})"
        )
    if list(times) != sorted(times):
        raise ParameterError(f"{prefix}.times", times, "ascending times")
