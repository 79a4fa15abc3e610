"""From a study to the plans of its runs: what they start from, resolved, and what each row changes.

The resolved values are kept in the results' metadata, as JSON (with Python's ``Infinity``), independent of
later changes to files, and decide whether an interrupted sweep may resume.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.declarations import (
    Declaration,
    ParameterError,
    UnitError,
    Value,
    build,
    check,
    declarations,
    table_of,
    unknown_name,
    values_of,
    with_cells,
)
from trunk_msgs_util.parameters.files import ParameterFileError
from trunk_msgs_util.parameters.to_si import read_quantity, units_of
from trunk_sim.disturbance_config import DisturbanceConfig

from ..batch.block import wrong_duration
from ..errors import PlanError, StudyError
from ..plans.files import parse_setting
from ..plans.nodes import NODES
from ..plans.plan import RunPlan, check_turns, make_plan
from ..runs.loop_inputs import check as check_offline
from .study import ContenderSpec, Scalar, StudySpec, Target, Variable, drawn_values

# Which CSV a run reads; its numbers take the place of the name when a plan is made.
FILES = ("reference.file", "table.file")
# `make_plan` checks these against other nodes' values: each value needs its own plan.
STRUCTURAL = ("update_rate", "joint", *FILES)
SEEDS = {
    "simulator": ("sensor.seed", "link.seed"),
    "disturbance": ("noise.seed", "pulse.random_seed"),
}
# If these are zero, the seed makes no difference.
_NOISE = {
    "simulator": (
        *("sensor.position_noise", "sensor.velocity_noise", "sensor.dropout"),
        *("link.state.jitter", "link.state.loss", "link.state.burst.begin"),
        *("link.command.jitter", "link.command.loss", "link.command.burst.begin"),
    ),
    "disturbance": ("noise.rms", "pulse.random_count"),
}

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


def make_bases(study: StudySpec) -> Bases:
    """Return the plans that the runs start from, after checking the whole study.

    Raises StudyError for a variable that matches no parameter or leaves its bounds, for a run that a
    compiled loop cannot make, and for scenario and parameter files that `make_plan` refuses.
    """
    varied = structural(study)
    for v in varied:
        if v.distribution is not None or v.how != "value":
            raise mistake(study, v, f"{v.targets[0]} can only be varied by given values")
    bases: Bases = {}
    for contender in study.contenders:
        for values in product(*(v.values for v in varied)):
            settings = [
                f"{target.node_with(contender)}.{target.name}={value}"
                for v, value in zip(varied, values, strict=True)
                for target in v.targets
                if is_meant(target, contender)
            ]
            base = bases[contender.label, values] = _base(study, contender, settings)
            check_contender(study, contender, base)
        first = bases[contender.label, tuple(v.values[0] for v in varied)]
        for v in study.variables:
            check_variable(study, v, contender, first)
            check_durations(study, v, contender, bases)
    for v in study.variables:
        if not any(is_meant(t, c) for t in v.targets for c in study.contenders):
            raise mistake(study, v, f"{v.targets[0]}: that controller is not in the study")
    check_repetition(study, bases.values())
    return bases


def plan_of(study: StudySpec, bases: Bases, row: Row) -> RunPlan:
    """Return a row's plan. Raises ParameterError if its values do not fit together."""
    contender = next(c for c in study.contenders if c.label == row["controller"])
    base = bases[contender.label, tuple(row[v.name] for v in structural(study))]
    configs = base.configs
    changed: dict[str, dict[str, Any]] = {node: {} for node in configs}
    if study.runs > 1:
        for node, names in SEEDS.items():
            for name in names:
                changed[node][field_of(configs[node], name)] = row["seed"]
    for v in study.variables:
        for target in v.targets:
            if target.name in STRUCTURAL or not is_meant(target, contender):
                continue
            node = kind_of(target, contender)
            field = field_of(configs[node], target.name)
            old = changed[node].get(field, getattr(configs[node], field))
            changed[node][field] = new_value(configs[node], target, old, v.how, row[v.name])
    made = {
        node: replace(config, **changed[node]) if changed[node] else config
        for node, config in configs.items()
    }
    disturbance = made["disturbance"]
    return replace(
        base.plan,
        simulator=made["simulator"],
        controllers={base.plan.controller_name: made["controller"]},
        disturbance=disturbance if disturbance.active else None,
    )


def _base(study: StudySpec, contender: ContenderSpec, settings: list[str]) -> Base:
    everywhere = {"update_rate": study.rate, "duration": study.duration}

    def plan(*more: str) -> RunPlan:
        return make_plan(
            study.scenario,
            contender.node,
            [*study.params, *contender.params],
            [
                replace(parse_setting(text, "set"), folder=Path(study.source).parent)
                for text in (*study.settings, *contender.settings, *settings, *more)
            ],
            {name: value for name, value in everywhere.items() if value is not None},
            others=[other.node for other in study.contenders],
        )

    try:
        made = plan()
        if made.disturbance is not None:
            return Base(made, made.disturbance)
        # A plan drops a disturbance that does nothing. A sine keeps it in; it is zeroed again below.
        forced = plan("disturbance.sine.amplitude=1.0").disturbance
    except (PlanError, ParameterError, ParameterFileError) as error:
        raise StudyError(f"{study.source}: {contender.label}: {error}") from None
    if forced is None:
        raise StudyError(f"{study.source}: {contender.label}: no disturbance node")
    return Base(made, replace(forced, sine_amplitude=0.0))


def mistake(study: StudySpec, v: Variable, message: str) -> StudyError:
    """Return the error that names a study's entry."""
    return StudyError(f"{study.source}: vary.{v.name}: {message}")


def check_contender(study: StudySpec, contender: ContenderSpec, base: Base) -> None:
    """Raise StudyError if a compiled loop cannot run the contender, or not for that long."""
    try:
        check_offline(base.plan)
        check_turns(base.plan)
    except PlanError as error:
        raise StudyError(f"{study.source}: {contender.label}: {error}") from None
    wrong = wrong_duration(base.plan.simulator.duration, base.plan.simulator.update_rate)
    if wrong:
        raise StudyError(f"{study.source}: {contender.label}: {wrong}")


def check_variable(study: StudySpec, v: Variable, contender: ContenderSpec, base: Base) -> None:
    """Raise StudyError if a variable matches none of the contender's parameters, or leaves its bounds."""
    values = v.values if v.distribution is None else drawn_values(study)[v.name]
    for target in v.targets:
        if not is_meant(target, contender) or target.name in FILES:
            continue
        config = base.configs[kind_of(target, contender)]
        _check_target(study, v, contender, target, config)
        try:
            check_units(study, v, target, config)
        except UnitError as error:
            raise mistake(study, v, f"{target}: {error}") from None
        if v.how != "value" and not all(isinstance(value, int | float) for value in values):
            raise mistake(study, v, f"{target}: as {v.how}: numbers are needed")
        old = getattr(config, field_of(config, target.name))
        try:
            for value in set(values):
                new = new_value(config, target, old, v.how, value)
                if table_of(
                    target.name, declarations(type(config))
                ):  # only the whole knows its labels
                    replace(config, **{field_of(config, target.name): new})
        except ParameterError as error:
            raise mistake(study, v, f"{contender.label}: {target}: {error}") from None


def check_durations(study: StudySpec, v: Variable, contender: ContenderSpec, bases: Bases) -> None:
    """Raise StudyError if a variable makes one of the contender's runs endless, or too long."""
    for target in v.targets:
        if (target.node, target.name) != ("simulator", "duration"):
            continue
        values = set(v.values if v.distribution is None else drawn_values(study)[v.name])
        for base in (base for (label, _), base in bases.items() if label == contender.label):
            simulator = base.plan.simulator
            for value in values:
                new: Any = new_value(simulator, target, simulator.duration, v.how, value)
                wrong = wrong_duration(new, simulator.update_rate)
                if wrong:
                    raise mistake(study, v, f"{target}: {wrong}")


def check_repetition(study: StudySpec, bases: Iterable[Base]) -> None:
    """Raise StudyError if a study asks for several identical runs."""
    if study.runs == 1 or any(v.distribution for v in study.variables):
        return
    if any(_noisy(base) for base in bases):
        return
    for v in study.variables:
        noise = any(target.name in _NOISE.get(target.node, ()) for target in v.targets)
        if noise and v.how != "factor" and any(v.values):  # a factor leaves zero noise at zero
            return
    raise StudyError(
        f"{study.source}: runs: is {study.runs}, but nothing is drawn and there is no noise: "
        "leave it out"
    )


def _check_target(
    study: StudySpec, v: Variable, contender: ContenderSpec, target: Target, config: Any
) -> None:
    declared = declarations(type(config))
    if table := table_of(target.name, declared):
        if not declared[table].table or target.index is not None or v.how != "value":
            raise mistake(study, v, f"{contender.label}: {target}: a cell takes given values only")
        return
    if target.name not in declared:
        text = unknown_name(target.name, declared)
        raise mistake(study, v, f"{contender.label}: {target}: {text}")
    kind = declared[target.name].kind
    if target.name.startswith(("lockstep.", "wait_for", "joints")):
        raise mistake(study, v, f"{target} has no effect on a compiled run")
    old = getattr(config, field_of(config, target.name))
    if isinstance(old, tuple) and (target.index is None or target.index >= len(old)):
        raise mistake(
            study, v, f"{target}: it is {list(old)}: name one element, [0] to [{len(old) - 1}]"
        )
    if not isinstance(old, tuple) and target.index is not None:
        raise mistake(study, v, f"{target}: it is a single {kind}: leave out [...]")
    if v.how != "value" and not re.match("double", kind):
        raise mistake(study, v, f"{target}: as {v.how}: a double is needed, it is {kind}")


def _noisy(base: Base) -> bool:
    return any(
        getattr(base.configs[node], field_of(base.configs[node], name))
        for node, names in _NOISE.items()
        for name in names
    )


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


def plans_json(study: StudySpec, bases: Bases) -> str:
    """Return the plans that a study's runs start from: all parameters of each plan's nodes."""
    return json.dumps([_as_values(study, key, base) for key, base in bases.items()])


def bases_from(study: StudySpec, text: str, source: str) -> Bases:
    """Return the input of `plans_json`. Raises StudyError naming the source."""
    bases: Bases = {}
    try:
        for entry in json.loads(text):
            values = entry["parameters"]
            simulator, disturbance, controller = (
                build(NODES[node].config, values[node])
                for node in ("simulator", "disturbance", entry["node"])
            )
            plan = RunPlan(
                scenario=entry["scenario"],
                simulator=simulator,
                controllers={entry["node"]: controller},
                disturbance=disturbance if disturbance.active else None,
                recorder=RecorderConfig(),
            )
            varied = tuple(entry["varied"][v.name] for v in structural(study))
            bases[entry["controller"], varied] = Base(plan, disturbance)
        if set(bases) != set(keys(study)):
            raise KeyError("plans")
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        reason = error if isinstance(error, ParameterError) else type(error).__name__
        raise StudyError(
            f"{source}: plans that this version does not understand ({reason}): sweep the study again"
        ) from None
    return bases


def identity(study: StudySpec, bases: Bases) -> dict[str, Any]:
    """Return, as JSON values, what determines a sweep's results: no file names, no comments."""
    content = {
        "variables": [_plain(v) for v in study.variables],
        "controllers": [[c.label, c.node] for c in study.contenders],
        "runs": study.runs,
        "seed": study.seed,
        "draws": {name: _hash(values) for name, values in drawn_values(study).items()},
        "block": study.block,
        "plans": [_as_values(study, key, base) for key, base in bases.items()],
    }
    document: dict[str, Any] = json.loads(json.dumps(content))
    return document


def digest(content: Mapping[str, Any]) -> str:
    """Return a hash of an identity."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Return in words how blocks of an old identity differ from those of a new one; empty: not at all."""
    for name in ("variables", "controllers", "runs", "seed", "draws", "block"):
        if old.get(name) != new[name]:
            return f"are another study's: its {name} differ{'s' * (name in ('seed', 'block'))}"
    for before, after in zip(old.get("plans", []), new["plans"], strict=False):
        for node, values in after["parameters"].items():
            for name, value in values.items():
                was = before["parameters"].get(node, {}).get(name)
                if was != value:
                    return (
                        "were made with other parameters: "
                        f"{after['controller']}: {node}.{name} was {was}, is now {value}"
                    )
    return "" if old.get("plans") == new["plans"] else "were made with other parameters"


def _plain(v: Variable) -> dict[str, Any]:
    """Return an entry as plain values; in which units it was written makes no difference."""
    return {name: value for name, value in asdict(v).items() if name != "written"}


def _hash(values: list[Any]) -> str:
    return hashlib.sha256(np.array(values).tobytes()).hexdigest()[:16]


def _as_values(study: StudySpec, key: Key, base: Base) -> dict[str, Any]:
    label, varied = key
    plan = base.plan
    return {
        "controller": label,
        "varied": {v.name: value for v, value in zip(structural(study), varied, strict=True)},
        "scenario": plan.scenario,
        "node": plan.controller_name,
        "parameters": {
            "simulator": values_of(plan.simulator),
            "disturbance": values_of(base.disturbance),
            plan.controller_name: values_of(plan.controller),
        },
    }
