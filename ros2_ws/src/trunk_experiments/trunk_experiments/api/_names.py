"""What can be given by name: scenarios, controllers, parameter files, studies, parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from trunk_control.laws import law_named
from trunk_msgs_util.parameters.csv_parameters import listed
from trunk_msgs_util.parameters.declarations import Value

from ..errors import PlanError, did_you_mean
from ..plans.files import SCENARIOS, shipped_files
from ..plans.nodes import CONTROLLERS, NODES


@dataclass(frozen=True)
class Parameter:
    """What a node declares about one parameter. Made by `parameters`.

    ``default`` is in ``unit``, SI; ``fixed``: it cannot change while a node runs.
    """

    name: str
    default: Value
    unit: str
    allowed: str
    description: str
    fixed: bool


def scenarios() -> dict[str, str]:
    """Return the shipped scenarios by name, with a line about each."""
    return {name: text for name, text in _shipped().items() if name in SCENARIOS}


def parameter_files() -> dict[str, str]:
    """Return the shipped parameter files by name, with a line about each: gains, tables, profiles."""
    return {name: text for name, text in _shipped().items() if name not in SCENARIOS}


def controllers() -> dict[str, str]:
    """Return the label of each controller, by the name of its node."""
    return {name: law_named(name).label for name in CONTROLLERS}


def studies() -> dict[str, str]:
    """Return the shipped studies by name, with a line about each."""
    from ..study.file import shipped_studies

    return {name: _first_line(path) for name, path in shipped_studies().items()}


def parameters(node: str) -> tuple[Parameter, ...]:
    """Return the parameters of ``simulator``, ``disturbance``, ``recorder`` or a controller, for `plan`.

    Raises PlanError for any other name.
    """
    if not isinstance(node, str) or node not in NODES:
        raise PlanError(
            f"no node {node!r}: give one of {', '.join(NODES)}{did_you_mean(str(node), NODES)}"
        )
    return tuple(
        Parameter(d.name, d.default, d.unit, d.allowed(), d.description, d.fixed)
        for d in listed(NODES[node].config).values()
    )


def _shipped() -> dict[str, str]:
    return {name: _first_line(path) for name, path in shipped_files().items()}


def _first_line(path: Path) -> str:
    return path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
