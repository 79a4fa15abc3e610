"""From a study to the plans of its runs: what they start from, what each row changes, how it ends.

A run is its row's changes, values by node and parameter, applied to the resolved values of its base. These
are kept in the results' metadata, as JSON (with Python's ``Infinity``), independent of later changes to
files, and decide whether an interrupted sweep may resume.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunk_core.errors import PlanError, StudyError
from trunk_core.parameters.declarations import (
    ParameterError,
    UnitError,
    build,
    changed,
    checked,
    declarations,
    table_of,
    unknown_name,
    value_of,
    values_of,
)
from trunk_core.parameters.parameter_files import ParameterFileError
from trunk_core.parameters.shared import PLANT_NAME, RecorderConfig
from trunk_core.parameters.to_si import read_quantity, units_of
from trunk_runs.loop import check as check_offline
from trunk_runs.nodes import config_class
from trunk_runs.plan import RunPlan, check_turns, make_plan
from trunk_runs.scenario import parse_setting

from .batch.block import Lanes, Maker, Outcomes, make_runs, wrong_duration
from .batch.varied import Rows, Varied
from .study import ContenderSpec, Scalar, StudySpec, Target, Variable, chosen_values, drawn_values

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
_WITHOUT_EFFECT = ("lockstep.", "wait_for", "joints")

AT_ONCE = 131_072  # runs on a device: with fewer, some of a large card's cores would be idle
Columns = Mapping[str, list[Any]]  # of rows, by name, as `design` returns them
Row = Mapping[str, Any]
# What runs start from, by controller's label and the values of the structural variables: plans before
# anything else varies, which keep the disturbance's values even if nothing disturbs.
Bases = dict[tuple[str, tuple[Scalar, ...]], RunPlan]


def rows_of(columns: Columns) -> Iterator[dict[str, Any]]:
    """Yield the rows of some columns."""
    return (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))


def outcomes(
    study: StudySpec, bases: Bases, columns: Columns, maker: Maker | None = None
) -> Outcomes:
    """Return how each row's run ended.

    ``maker``: what makes the runs; None: lanes of this process.
    What varies as a double passes through the parameters' checks and the plans for many rows at once
    (`Varied`); rows with values for which that cannot be have plans of their own.
    """
    count = len(columns["run"])
    ended = Outcomes(count)
    doubles = _doubles(study, columns)

    def plan_at(rows: Rows) -> RunPlan:
        row = row_at(columns, rows[0])
        if len(rows) > 1:
            row |= {name: Varied(values[rows]) for name, values in doubles.items()}
        return plan_of(study, bases, row)

    make_runs(maker or Lanes(), plan_at, _alike(study, columns, doubles), ended)
    return ended


def row_at(columns: Columns, i: int) -> dict[str, Any]:
    """Return a row of some columns."""
    return {name: values[i] for name, values in columns.items()}


def _doubles(study: StudySpec, columns: Columns) -> dict[str, NDArray[Any]]:
    """Return as arrays the columns of numbers that may differ between runs made together; the seeds too."""
    numbers = {"seed": np.array(columns["seed"])} if study.runs > 1 else {}
    plant = {PLANT_NAME: study.plant}
    for v in study.variables:
        kinds = {
            declared[target.name].kind if target.name in declared else ""
            for contender in study.contenders
            for target in v.targets
            for declared in [declarations(config_class(target.node_with(contender), plant))]
        }
        if all(kind.startswith("double") for kind in kinds) and v not in structural(study):
            numbers[v.name] = np.array(columns[v.name], dtype=np.float64)
    return numbers


def _alike(study: StudySpec, columns: Columns, numbers: Container[str]) -> Iterator[Rows]:
    """Yield the indices of rows with the same controller and the same values outside of ``numbers``."""
    names = ["controller", *(v.name for v in study.variables if v.name not in numbers)]
    places: dict[tuple[Any, ...], list[int]] = {}
    for i, values in enumerate(zip(*(columns[name] for name in names), strict=True)):
        places.setdefault((*values, *map(type, values)), []).append(i)
    return map(np.array, places.values())


def plan_of(study: StudySpec, bases: Bases, row: Row) -> RunPlan:
    """Return a row's plan. Raises ParameterError if its values do not fit together."""
    contender = next(c for c in study.contenders if c.label == row["controller"])
    base = bases[contender.label, tuple(row[v.name] for v in structural(study))]
    configs = base.configs
    changes: dict[str, dict[str, Any]] = {
        node: dict.fromkeys(SEEDS.get(node, ()) if study.runs > 1 else (), row["seed"])
        for node in ("simulator", "disturbance", contender.node)
    }
    for v, target, node in varied(study, contender):
        if target.name not in STRUCTURAL:
            changes[node] |= _change(v, target, configs[node], changes[node], row[v.name])
    for node, values in changes.items():
        if values:
            configs[node] = changed(configs[node], values)
    disturbance = configs["disturbance"]
    return replace(
        base,
        simulator=configs["simulator"],
        controllers={contender.node: configs[contender.node]},
        disturbance=disturbance if disturbance.active else None,
    )


def _change(
    v: Variable, target: Target, config: Any, changes: Mapping[str, Any], value: Any
) -> dict[str, Any]:
    """Return a value of an entry as a change, besides others, of one of its parameters."""
    name = target.parameter
    if v.how != "value":
        old = changes.get(name, value_of(config, name))
        value = old * value if v.how == "factor" else old + value
    return {name: value}


def structural(study: StudySpec) -> list[Variable]:
    """Return the variables whose values need their own plans."""
    return [v for v in study.variables if any(t.name in STRUCTURAL for t in v.targets)]


def varied(study: StudySpec, contender: ContenderSpec) -> Iterator[tuple[Variable, Target, str]]:
    """Yield each entry that varies a contender's runs, with each of its parameters, and that one's node."""
    for v in study.variables:
        for target in v.targets:
            node = target.node_with(contender)
            if node in ("simulator", "disturbance", contender.node):
                yield v, target, node


def make_bases(study: StudySpec) -> Bases:
    """Return the plans that the runs start from, after checking the whole study.

    Raises StudyError for a variable that matches no parameter or leaves its bounds, for a run that a
    compiled loop cannot make, and for scenario and parameter files that `make_plan` refuses.
    """
    for v in structural(study):
        if v.distribution is not None or v.how != "value":
            raise mistake(study, v, f"{v.targets[0]} can only be varied by given values")
    bases: Bases = {}
    taken = set()
    for contender in study.contenders:
        own: Bases = {
            (contender.label, values): _base(study, contender, values)
            for values in product(*(v.values for v in structural(study)))
        }
        for v, target, _ in varied(study, contender):
            taken.add(v.name)
            check_target(study, v, target, contender, list(own.values()))
        bases |= own
    for v in study.variables:
        if v.name not in taken:
            raise mistake(study, v, f"{v.targets[0]}: that controller is not in the study")
    check_repetition(study, bases.values())
    return bases


def _base(study: StudySpec, contender: ContenderSpec, values: tuple[Scalar, ...]) -> RunPlan:
    """Return one of a contender's bases. Raises StudyError if a compiled loop cannot run it that long."""
    chosen = dict(zip((v.name for v in structural(study)), values, strict=True))
    everywhere = {"update_rate": study.rate, "duration": study.duration}
    settings = [
        *(*study.settings, *contender.settings),
        *(
            f"{node}.{target.name}={chosen[v.name]}"
            for v, target, node in varied(study, contender)
            if v.name in chosen
        ),
    ]
    try:
        plan = make_plan(
            study.scenario,
            contender.node,
            [*study.params, *contender.params],
            [
                replace(parse_setting(text, "set"), folder=Path(study.source).parent)
                for text in settings
            ],
            {name: value for name, value in everywhere.items() if value is not None},
            others=[other.node for other in study.contenders],
            quiet=True,
        )
        check_offline(plan)
        check_turns(plan)
    except (PlanError, ParameterError, ParameterFileError) as error:
        raise StudyError(f"{study.source}: {contender.label}: {error}") from None
    if wrong := wrong_duration(plan.simulator.duration, plan.simulator.update_rate):
        raise StudyError(f"{study.source}: {contender.label}: {wrong}")
    return plan


def mistake(study: StudySpec, v: Variable, message: str) -> StudyError:
    """Return the error that names a study's entry."""
    return StudyError(f"{study.source}: vary.{v.name}: {message}")


def check_target(
    study: StudySpec, v: Variable, target: Target, contender: ContenderSpec, bases: list[RunPlan]
) -> None:
    """Raise StudyError if an entry's target is no parameter of the contender's runs, or leaves its bounds."""
    node = target.node_with(contender)
    config = bases[0].configs[node]
    declared = declarations(type(config))
    # 2 and 2.0 are not the same to an integer.
    values = list({(type(value), value): value for value in chosen_values(study, v)}.values())
    if target.name in FILES:
        return
    table = table_of(target.name, declared)
    if table:
        if not declared[table].table or target.index is not None or v.how != "value":
            text = f"{contender.label}: {target}: a cell takes given values only"
            raise mistake(study, v, text)
    elif target.name not in declared:
        text = unknown_name(target.name, declared)
        raise mistake(study, v, f"{contender.label}: {target}: {text}")
    elif target.name.startswith(_WITHOUT_EFFECT):
        raise mistake(study, v, f"{target} has no effect on a compiled run")
    else:
        kind, old = declared[target.name].kind, value_of(config, target.name)
        if isinstance(old, tuple) and (target.index is None or target.index >= len(old)):
            text = f"it is {list(old)}: name one element, [0] to [{len(old) - 1}]"
            raise mistake(study, v, f"{target}: {text}")
        if not isinstance(old, tuple) and target.index is not None:
            raise mistake(study, v, f"{target}: it is a single {kind}: leave out [...]")
        if v.how != "value" and not kind.startswith("double"):
            raise mistake(study, v, f"{target}: as {v.how}: a double is needed, it is {kind}")
        try:
            check_units(study, v, target, config)
        except UnitError as error:
            raise mistake(study, v, f"{target}: {error}") from None
        if v.how != "value" and not all(isinstance(value, int | float) for value in values):
            raise mistake(study, v, f"{target}: as {v.how}: numbers are needed")

    def fault(values: Iterable[Any]) -> str:
        try:
            for value in values:
                change = _change(v, target, config, {}, value)
                if table:  # only the whole knows its labels
                    changed(config, change)
                else:
                    checked(type(config), change, partial(values_of, config))
        except ParameterError as error:
            return str(error)
        return ""

    plain = not table and all(isinstance(value, float) for value in values)
    together = [Varied(np.array(values))] if plain else values
    with np.errstate(all="ignore"):
        doubtful = bool(fault(together))
    if doubtful:  # which value it is, each alone says
        raise mistake(study, v, f"{contender.label}: {target}: {fault(values)}")
    if (node, target.name) == ("simulator", "duration"):
        for simulator, value in product((base.simulator for base in bases), values):
            duration = changed(simulator, _change(v, target, simulator, {}, value)).duration
            if wrong := wrong_duration(duration, simulator.update_rate):
                raise mistake(study, v, f"{target}: {wrong}")


def check_units(study: StudySpec, v: Variable, target: Target, config: Any) -> None:
    """Check an entry's units where another parameter of the node chooses the unit. Raises UnitError."""
    declared = declarations(type(config))[target.name]
    if not declared.unit_by or v.how == "factor":
        return
    chooser = Target(target.node, declared.unit_by)
    varying = [entry for entry in study.variables if chooser in entry.targets]
    now = (value_of(config, declared.unit_by),)
    for chosen in (varying[0].distribution or varying[0]).values if varying else now:
        (allowed,) = units_of(declared, {declared.unit_by: chosen})
        for text in v.written:
            try:
                read_quantity(text, *allowed)
            except UnitError as error:
                raise UnitError(
                    f"{text!r} is not allowed where {declared.unit_by} is {chosen}: {error}"
                ) from None


def check_repetition(study: StudySpec, bases: Iterable[RunPlan]) -> None:
    """Raise StudyError if a study asks for several identical runs."""
    if study.runs == 1 or any(v.distribution for v in study.variables):
        return
    noise = [(node, name) for node, names in _NOISE.items() for name in names]
    if any(value_of(base.configs[node], name) for base in bases for node, name in noise):
        return
    for v in study.variables:
        noisy = any((target.node, target.name) in noise for target in v.targets)
        if noisy and v.how != "factor" and any(v.values):  # a factor leaves zero noise at zero
            return
    raise StudyError(
        f"{study.source}: runs: is {study.runs}, but nothing is drawn and there is no noise: "
        "leave it out"
    )


def plans_json(study: StudySpec, bases: Bases) -> str:
    """Return the plans that a study's runs start from: all parameters of each plan's nodes."""
    return json.dumps(_plain_plans(study, bases))


def _plain_plans(study: StudySpec, bases: Bases) -> list[dict[str, Any]]:
    names = [v.name for v in structural(study)]
    return [
        {
            "controller": label,
            "varied": dict(zip(names, values, strict=True)),
            "scenario": plan.scenario,
            "node": plan.controller_name,
            "parameters": {
                node: values_of(plan.configs[node])
                for node in ("simulator", "disturbance", plan.controller_name)
            },
        }
        for (label, values), plan in bases.items()
    ]


def bases_from(study: StudySpec, text: str, source: str) -> Bases:
    """Return the input of `plans_json`. Raises StudyError naming the source."""
    bases: Bases = {}
    try:
        for entry in json.loads(text):
            simulator, disturbance, controller = (
                build(config_class(node, entry["parameters"][node]), entry["parameters"][node])
                for node in ("simulator", "disturbance", entry["node"])
            )
            bases[
                entry["controller"], tuple(entry["varied"][v.name] for v in structural(study))
            ] = RunPlan(
                scenario=entry["scenario"],
                simulator=simulator,
                controllers={entry["node"]: controller},
                disturbance=disturbance,
                recorder=RecorderConfig(),
            )
        points = list(product(*(v.values for v in structural(study))))
        if set(bases) != {(c.label, values) for c in study.contenders for values in points}:
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
        # In which units an entry was written makes no difference.
        "variables": [
            {n: x for n, x in asdict(v).items() if n != "written"} for v in study.variables
        ],
        "controllers": [[c.label, c.node] for c in study.contenders],
        "runs": study.runs,
        "seed": study.seed,
        "draws": {
            name: hashlib.sha256(np.array(values).tobytes()).hexdigest()[:16]
            for name, values in drawn_values(study).items()
        },
        "block": study.block,
        "plans": _plain_plans(study, bases),
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
