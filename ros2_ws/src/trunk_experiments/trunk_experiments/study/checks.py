"""Refuses studies that cannot be run, before the first run and in one line."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from trunk_msgs_util.parameters.declarations import (
    ParameterError,
    UnitError,
    declarations,
    table_of,
    unknown_name,
)

from ..batch.block import wrong_duration
from ..errors import PlanError, StudyError
from ..plans.plan import check_turns
from ..runs.loop_inputs import check
from .design import drawn_values
from .study import ContenderSpec, StudySpec, Target, Variable
from .targets import FILES, Base, Bases, field_of, is_meant, kind_of, new_value
from .units import check_units

# If these are zero, the seed makes no difference.
_NOISE = {
    "simulator": (
        *("sensor.position_noise", "sensor.velocity_noise", "sensor.dropout"),
        *("link.state.jitter", "link.state.loss", "link.state.burst.begin"),
        *("link.command.jitter", "link.command.loss", "link.command.burst.begin"),
    ),
    "disturbance": ("noise.rms", "pulse.random_count"),
}


def mistake(study: StudySpec, v: Variable, message: str) -> StudyError:
    """Return the error that names a study's entry."""
    return StudyError(f"{study.source}: vary.{v.name}: {message}")


def check_contender(study: StudySpec, contender: ContenderSpec, base: Base) -> None:
    """Raise StudyError if a compiled loop cannot run the contender, or not for that long."""
    try:
        check(base.plan)
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
