"""Which parameter of a run a study's entry refers to, and the value that it gets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from itertools import product
from typing import Any

from trunk_msgs_util.parameters.declarations import (
    Declaration,
    Value,
    check,
    table_of,
    values_of,
    with_cells,
)
from trunk_sim.disturbance_config import DisturbanceConfig

from ..plans.plan import RunPlan
from .study import ContenderSpec, Scalar, StudySpec, Target, Variable

# Which CSV a run reads; its numbers take the place of the name when a plan is made.
FILES = ("reference.file", "table.file")
# `make_plan` checks these against other nodes' values: each value needs its own plan.
STRUCTURAL = ("update_rate", "joint", *FILES)


Row = Mapping[str, Any]


@dataclass(frozen=True)
class Base:
    """A plan before anything varies, with the disturbance's values even if nothing disturbs."""

    plan: RunPlan
    disturbance: DisturbanceConfig

    @property
    def configs(self) -> dict[str, Any]:
        """What can vary, by kind of node."""
        return {
            "simulator": self.plan.simulator,
            "disturbance": self.disturbance,
            "controller": self.plan.controller,
        }


Key = tuple[str, tuple[Scalar, ...]]  # controller's label, values of the structural variables
Bases = dict[Key, Base]


def structural(study: StudySpec) -> list[Variable]:
    """Return the variables whose values need their own plans."""
    return [v for v in study.variables if any(t.name in STRUCTURAL for t in v.targets)]


def keys(study: StudySpec) -> Iterator[Key]:
    """Yield the key of each plan that the study's runs start from."""
    values = [v.values for v in structural(study)]
    for contender in study.contenders:
        for chosen in product(*values):
            yield contender.label, chosen


def node_of(target: Target, contender: ContenderSpec) -> str:
    """Return the name of the target's node in a contender's runs."""
    return contender.node if target.node == "controller" else target.node


def kind_of(target: Target, contender: ContenderSpec) -> str:
    """Return the target's kind of node: simulator, disturbance or controller."""
    return "controller" if target.node == contender.node else target.node


def is_meant(target: Target, contender: ContenderSpec) -> bool:
    """Return True if the target is a parameter of a node that runs with the contender."""
    return target.node in ("simulator", "disturbance", "controller", contender.node)


def field_of(config: Any, name: str) -> str:
    """Return the name of the configuration's field that holds a parameter."""
    fields = _fields(type(config))
    return fields[table_of(name, fields) or name][0]


def new_value(config: Any, target: Target, old: Any, how: str, value: Any) -> Value:
    """Return a parameter's new value. Raises ParameterError if it is not allowed."""
    fields = _fields(type(config))
    table = table_of(target.name, fields)
    if table:
        changed = with_cells(type(config), {target.name: value}, {**values_of(config), table: old})
        return check(fields[table][1], changed.get(table))
    declaration = fields[target.name][1]
    current = old if target.index is None else old[target.index]
    if how == "factor":
        value = current * value
    elif how == "offset":
        value = current + value
    if target.index is not None:
        value = (*old[: target.index], value, *old[target.index + 1 :])
    return check(declaration, value)


_FIELDS: dict[type[Any], dict[str, tuple[str, Declaration]]] = {}


def _fields(config: type[Any]) -> dict[str, tuple[str, Declaration]]:
    """Return a configuration's fields and declarations by parameter name."""
    if config not in _FIELDS:
        _FIELDS[config] = {
            f.metadata["declaration"].name: (f.name, f.metadata["declaration"])
            for f in fields(config)
            if "declaration" in f.metadata
        }
    return _FIELDS[config]
