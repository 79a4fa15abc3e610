"""From a study to its runs: the table of what varies, and the plan of each row.

Row = ((grid point) x runs + draw) x controllers + controller: what is drawn, seeds included, depends
on the draw alone, so that all controllers and all grid points meet the same conditions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.parameters.declarations import (
    Declaration,
    ParameterError,
    Value,
    check,
    declarations,
    unknown_name,
)
from trunk_sim.disturbance_config import DisturbanceConfig

from ..errors import PlanError, StudyError
from ..plans.plan import RunPlan, make_plan
from .draws import stream
from .study import Contender, Scalar, Study, Target, Variable

STRUCTURAL = ("update_rate", "joint")  # checked by `make_plan` against other nodes' values
SEEDS = {"simulator": "sensor.seed", "disturbance": "noise.seed"}
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Base:
    """A plan before anything varies, with the disturbance's values even where nothing disturbs."""

    plan: RunPlan
    disturbance: DisturbanceConfig


Key = tuple[str, tuple[Scalar, ...]]  # controller's label, values of the structural variables
Bases = dict[Key, Base]


def design(study: Study, first: int, last: int) -> dict[str, list[Any]]:
    """Return columns of the rows first <= row < last: run, controller, point, draw, seed, variables."""
    rows = np.arange(first, last)
    labels = [contender.label for contender in study.contenders]
    which = rows % len(labels)
    draw = rows // len(labels) % study.runs
    point = rows // (len(labels) * study.runs)
    drawn = _drawn(study)
    places = np.unravel_index(point, study.shape) if study.shape else ()
    at = dict(zip((v.name for v in study.grid), places, strict=True))
    columns: dict[str, list[Any]] = {
        "run": rows.tolist(),
        "controller": [labels[i] for i in which],
        "point": point.tolist(),
        "draw": draw.tolist(),
        "seed": [drawn[""][i] if study.runs > 1 else None for i in draw],
    }
    for v in study.variables:
        chosen = v.values if v.distribution is None else drawn[v.name]
        columns[v.name] = [chosen[i] for i in at.get(v.name, draw)]
    return columns


@lru_cache(maxsize=1)
def _drawn(study: Study) -> dict[str, list[Any]]:
    found = {
        v.name: v.distribution.draw(study.runs, study.seed, v.name)
        for v in study.variables
        if v.distribution is not None
    }
    return {**found, "": stream(study.seed, "").integers(2**31, size=study.runs).tolist()}


def make_bases(study: Study) -> Bases:
    """Return the plans that the runs start from, and refuse what no run could be made of.

    Raises StudyError for a variable that fits no parameter or leaves its bounds; scenario and parameter
    files raise as `make_plan` does.
    """
    structural = [v for v in study.variables if any(t.name in STRUCTURAL for t in v.targets)]
    for v in structural:
        if v.distribution is not None or v.how != "value":
            raise _error(study, v, f"{v.targets[0]} can only be varied by given values")
    bases: Bases = {}
    for contender in study.contenders:
        for values in product(*(v.values for v in structural)):
            settings = [
                f"{_node(target, contender)}.{target.name}={value}"
                for v, value in zip(structural, values, strict=True)
                for target in v.targets
                if _meant(target, contender)
            ]
            bases[contender.label, values] = _base(study, contender, settings)
        base = bases[contender.label, tuple(v.values[0] for v in structural)]
        for v in study.variables:
            _check_variable(study, v, contender, base)
    for v in study.variables:
        if not any(_meant(t, c) for t in v.targets for c in study.contenders):
            raise _error(study, v, f"{v.targets[0]}: that controller is not in the study")
    return bases


def plan_of(study: Study, bases: Bases, row: Row) -> RunPlan:
    """Return a row's plan. Raises ParameterError where its values do not fit one another."""
    contender = next(c for c in study.contenders if c.label == row["controller"])
    structural = [v for v in study.variables if any(t.name in STRUCTURAL for t in v.targets)]
    base = bases[contender.label, tuple(row[v.name] for v in structural)]
    configs = _configs(base)
    changed: dict[str, dict[str, Any]] = {node: {} for node in configs}
    if study.runs > 1:
        for node, name in SEEDS.items():
            changed[node][_field(configs[node], name)] = row["seed"]
    for v in study.variables:
        for target in v.targets:
            if target.name in STRUCTURAL or not _meant(target, contender):
                continue
            node = _kind(target, contender)
            field = _field(configs[node], target.name)
            old = changed[node].get(field, getattr(configs[node], field))
            changed[node][field] = _new(configs[node], target, old, v.how, row[v.name])
    made = {node: replace(config, **changed[node]) for node, config in configs.items()}
    disturbance = made["disturbance"]
    return replace(
        base.plan,
        simulator=made["simulator"],
        controllers={base.plan.controller_name: made["controller"]},
        disturbance=disturbance if disturbance.active else None,
    )


def _base(study: Study, contender: Contender, settings: list[str]) -> Base:
    everywhere = {"update_rate": study.rate, "duration": study.duration}

    def plan(*more: str) -> RunPlan:
        return make_plan(
            study.scenario,
            contender.node,
            [*study.params, *contender.params],
            [*study.settings, *contender.settings, *settings, *more],
            {name: value for name, value in everywhere.items() if value is not None},
        )

    try:
        made = plan()
        if not made.simulator.duration:
            raise PlanError("simulator: duration is 0: a run of a sweep needs an end")
        if made.disturbance is not None:
            return Base(made, made.disturbance)
        # A plan keeps nothing of a disturbance that does nothing; its sine has amplitude 0 then.
        forced = plan("disturbance.sine.amplitude=1.0").disturbance
    except TrunkError as error:
        raise StudyError(f"{study.source}: {contender.label}: {error}") from None
    if forced is None:
        raise StudyError(f"{study.source}: {contender.label}: no disturbance node")
    return Base(made, replace(forced, sine_amplitude=0.0))


def _configs(base: Base) -> dict[str, Any]:
    return {
        "simulator": base.plan.simulator,
        "disturbance": base.disturbance,
        "controller": base.plan.controller,
    }


def _node(target: Target, contender: Contender) -> str:
    return contender.node if target.node == "controller" else target.node


def _kind(target: Target, contender: Contender) -> str:
    return "controller" if target.node == contender.node else target.node


def _meant(target: Target, contender: Contender) -> bool:
    """Return True where the target is a parameter of a node that runs with the contender."""
    return target.node in ("simulator", "disturbance", "controller", contender.node)


_FIELDS: dict[type[Any], dict[str, tuple[str, Declaration]]] = {}


def _fields_of(config: Any) -> dict[str, tuple[str, Declaration]]:
    """Return a configuration's fields and declarations by parameter name."""
    kind = type(config)
    if kind not in _FIELDS:
        _FIELDS[kind] = _declared_fields(kind)
    return _FIELDS[kind]


def _declared_fields(config: type[Any]) -> dict[str, tuple[str, Declaration]]:
    return {
        f.metadata["declaration"].name: (f.name, f.metadata["declaration"])
        for f in fields(config)
        if "declaration" in f.metadata
    }


def _field(config: Any, name: str) -> str:
    return _fields_of(config)[name][0]


def _new(config: Any, target: Target, old: Any, how: str, value: Any) -> Value:
    """Return a parameter's new value. Raises ParameterError where it is not allowed."""
    declaration = _fields_of(config)[target.name][1]
    one = old if target.index is None else old[target.index]
    if how == "factor":
        value = one * value
    elif how == "offset":
        value = one + value
    if target.index is not None:
        value = (*old[: target.index], value, *old[target.index + 1 :])
    return check(declaration, value)


def _check_variable(study: Study, v: Variable, contender: Contender, base: Base) -> None:
    configs = _configs(base)
    values = v.values if v.distribution is None else _drawn(study)[v.name]
    for target in v.targets:
        if not _meant(target, contender):
            continue
        config = configs[_kind(target, contender)]
        declared = declarations(type(config))
        if target.name not in declared:
            text = unknown_name(target.name, declared)
            raise _error(study, v, f"{contender.label}: {target}: {text}")
        declaration = declared[target.name]
        if target.name.startswith(("lockstep.", "wait_for", "joints")):
            raise _error(study, v, f"{target} does not decide a compiled run")
        old = getattr(config, _field(config, target.name))
        if isinstance(old, tuple) and (target.index is None or target.index >= len(old)):
            raise _error(
                study, v, f"{target}: it is {list(old)}: name one element, [0] to [{len(old) - 1}]"
            )
        if not isinstance(old, tuple) and target.index is not None:
            raise _error(study, v, f"{target}: it is a single {declaration.kind}: leave out [...]")
        if v.how != "value" and not re.match("double", declaration.kind):
            raise _error(
                study, v, f"{target}: as {v.how}: a double is needed, it is {declaration.kind}"
            )
        if v.how != "value" and not all(isinstance(value, int | float) for value in values):
            raise _error(study, v, f"{target}: as {v.how}: numbers are needed")
        try:
            for value in set(values):
                _new(config, target, old, v.how, value)
        except ParameterError as error:
            raise _error(study, v, f"{contender.label}: {target}: {error}") from None


def _error(study: Study, v: Variable, message: str) -> StudyError:
    return StudyError(f"{study.source}: vary.{v.name}: {message}")
