"""From a study to the plans of its runs: the base plans, and what each row changes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.parameters.files import ParameterFileError

from ..errors import PlanError, StudyError
from ..plans.files import parse_setting
from ..plans.plan import RunPlan, make_plan
from .checks import check_contender, check_durations, check_repetition, check_variable, mistake
from .study import ContenderSpec, StudySpec
from .targets import (
    STRUCTURAL,
    Base,
    Bases,
    Row,
    field_of,
    is_meant,
    kind_of,
    new_value,
    node_of,
    structural,
)

SEEDS = {
    "simulator": ("sensor.seed", "link.seed"),
    "disturbance": ("noise.seed", "pulse.random_seed"),
}


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
                f"{node_of(target, contender)}.{target.name}={value}"
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
