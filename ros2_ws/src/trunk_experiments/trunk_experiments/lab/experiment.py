"""An experiment that a lab has saved: its parameters, branch and pushes by hand, and what came of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.files import Layer, Section, check_names
from trunk_sim.operator_input import Applied
from trunk_sim.simulation import DivergedError

from ..errors import PlanError
from ..plans.files import config_from
from ..plans.nodes import CONTROLLERS, declared_names
from ..plans.plan import RunPlan, check_joints, check_rates
from ..plans.pushes import Pushes
from ..replay.branch import with_settings
from ..runs.engine import states_of_run
from ..runs.loop_inputs import check_compilable, states_of
from ..runs.offline_recording import Progress, record_states
from ..runs.states import TERMS, States

FORMAT = "trunk experiment 1"
_KEYS: Mapping[str, tuple[type, ...]] = {
    "format": (str,),
    "scenario": (str,),
    "controller": (str,),
    "page": (str,),
    "parameters": (dict,),
    "branch": (dict, type(None)),
    "pushes": (list,),
    "states": (int,),
    "sha256": (str, type(None)),
}
MOST_STATES = 200_000  # a table in a page's memory
_MOST = 10_000_000  # bytes of a file
_LONGEST = 200  # characters of a name


def check_plan(plan: RunPlan) -> None:
    """Raise PlanError for a plan of one controller that a lab cannot compute."""
    check_compilable(plan)
    simulator = plan.simulator
    states = states_of(plan)
    if states > MOST_STATES:
        raise PlanError(
            f"simulator.duration {simulator.duration:g} s at {simulator.update_rate:g} Hz: a lab has at most "
            f"{MOST_STATES:,} states, not {states:,}: give --duration or --rate"
        )
    if simulator.network is not None:
        raise PlanError(
            "simulator.link: messages that are late or lost are not in a lab: leave out link.*"
        )
    if plan.recorder.markers:
        raise PlanError("recorder.markers: a lab records no picture: set it to false")
    for name, config in plan.controllers.items():
        if config.active_times:
            raise PlanError(
                f"{name}.active.times: in a lab each controller acts alone, all the time"
            )


class Experiment(NamedTuple):
    """A plan, and how many states the browser computed, with which digest; empty: it could take none."""

    plan: RunPlan
    states: int
    sha256: str
    page: str  # the digest of the page


def read_experiment(path: Path) -> Experiment:
    """Return the experiment in a file. Raises PlanError, one line, for anything else."""
    try:
        if path.stat().st_size > _MOST:
            raise PlanError(f"more than {_MOST:,} bytes")
        data = json.loads(path.read_bytes())
        json.dumps(data, ensure_ascii=False).encode()  # no half of a character
        return _experiment(data, str(path))
    except OSError as error:
        raise PlanError(f"{path}: {error.strerror}: give an experiment of a lab") from None
    except (ValueError, ArithmeticError, RecursionError, TrunkError) as error:
        reason = str(error).removeprefix(f"{path}: ").splitlines()[0]
        raise PlanError(f"{path}: it is no experiment that a lab saved: {reason}") from None


def record_experiment(
    experiment: Experiment,
    path: Path,
    overwrite: bool = False,
    progress: Progress = lambda done, of: None,
) -> tuple[int, DivergedError | None, str]:
    """Write the recording of an experiment; return how many states it has, and why it diverged, if it did.

    The third value says in what it differs from the browser's run; empty: in no bit. Raises OSError.
    """
    digest, plan, count = hashlib.sha256(), experiment.plan, 0

    def states() -> Iterator[States]:
        nonlocal count
        for part in states_of_run(plan):
            digest.update(np.ascontiguousarray(part.table[:, :TERMS]).tobytes())
            count += len(part.table)
            yield part

    origin, diverged = {"experiment_page": experiment.page}, None
    try:
        record_states(plan, states(), path, tuple(plan.controllers), overwrite, progress, origin)
    except DivergedError as error:
        diverged = error
    ours = digest.hexdigest()
    difference = ""
    if (count, ours) != (experiment.states, experiment.sha256 or ours):
        difference = (
            f"its {count} states, SHA-256 {ours[:12]}…, are not the browser's {experiment.states}, "
            f"{experiment.sha256[:12] or 'none'}…: it was edited, or its page is of another version"
        )
    return count, diverged, difference


def _experiment(data: Any, source: str) -> Experiment:
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise PlanError(f"its format is not {FORMAT!r}")
    odd = sorted(_KEYS.keys() ^ data.keys()) or [
        key for key, kinds in _KEYS.items() if type(data[key]) not in kinds
    ]
    if odd:
        raise PlanError(f"{odd[0][:40]} is missing, unknown, or of another type")
    name, parameters = data["controller"], data["parameters"]
    for key in ("scenario", "page"):
        if len(data[key]) > _LONGEST or not data[key].isprintable():
            raise PlanError(f"{key} is not a line of at most {_LONGEST} characters")
    if name not in CONTROLLERS:
        raise PlanError(f"controller {name[:40]!r} is not one of {', '.join(CONTROLLERS)}")
    if not {"simulator", name} <= parameters.keys() <= {"simulator", name, "disturbance"}:
        raise PlanError(f"parameters: simulator, {name} and disturbance are needed")
    layer = _layer(parameters, source)
    configs = {node: config_from(node, [layer], "").config for node in parameters}
    disturbance = configs.get("disturbance")
    active = disturbance is not None and disturbance.active
    simulator = configs["simulator"]
    others = [topic for topic in simulator.wait_for if topic != "disturbance"]
    waited = (*others[:1], *(["disturbance"] if active else []), *others[1:])
    plan = RunPlan(
        scenario=data["scenario"],
        simulator=replace(simulator, wait_for=waited),
        controllers={name: configs[name]},
        disturbance=disturbance if active else None,
        recorder=RecorderConfig(controllers=(name,)),
    )
    check_joints(plan)
    check_rates(plan)
    check_plan(plan)
    plan = replace(plan, pushes=_pushes(data["pushes"], plan))
    if data["branch"] is not None:
        plan = _branched(plan, data["branch"], parameters, source)
    return Experiment(plan, data["states"], data["sha256"] or "", data["page"])


def _branched(plan: RunPlan, branch: Any, parameters: Any, source: str) -> RunPlan:
    """Return the plan with what a branch changes; a disturbance that did nothing begins with it."""
    at_ns, changed = branch.get("at_ns"), branch.get("parameters")
    period_ns = plan.simulator.period_ns
    if branch.keys() != {"at_ns", "parameters"} or not isinstance(changed, dict):
        raise PlanError("branch: at_ns and parameters are needed")
    if type(at_ns) is not int or at_ns not in range(0, states_of(plan) * period_ns, period_ns):
        raise PlanError(f"branch: at_ns {str(at_ns)[:40]} is the stamp of no state")
    layer = _layer(changed, source)
    if plan.disturbance is None and "disturbance" in changed and "disturbance" in parameters:
        whole = {**parameters["disturbance"], **changed["disturbance"]}
        layer = _layer({**changed, "disturbance": whole}, source)
    return with_settings(plan, at_ns, [layer])


def _layer(parameters: Mapping[str, Any], source: str) -> Layer:
    sections = []
    for node, values in parameters.items():
        if not isinstance(values, dict):
            raise PlanError(f"parameters of {node[:40]} are of another type")
        sections.append(Section(node, {name: _value(value) for name, value in values.items()}))
    layer = Layer(source, tuple(sections))
    check_names([layer], declared_names())
    return layer


def _value(value: Any) -> Any:
    """Return a value as parameter files have it: JSON has no infinities, they are texts."""
    if isinstance(value, list):
        return tuple(map(_value, value))
    return float(value) if value in ("inf", "-inf") else value


def _pushes(listed: list[Any], plan: RunPlan) -> Pushes:
    limits, period_ns = plan.simulator.operator_limits, plan.simulator.period_ns
    pushes: list[tuple[int, Applied]] = []
    stamps = range(0, states_of(plan) * period_ns, period_ns)
    if listed and limits is None:
        raise PlanError("pushes: operator.force and operator.torque are 0: nobody may push")
    for entry in listed:
        kinds = list(map(type, entry)) if isinstance(entry, list) else []
        if len(kinds) != 3 or kinds[0] is not int or not {*kinds} <= {int, float}:
            raise PlanError(f"pushes: {entry!r:.40}: a stamp in ns, N and N m are needed")
        stamp_ns, applied = entry[0], Applied(*map(float, entry[1:]))
        last_ns = pushes[-1][0] if pushes else -1
        if limits is None or limits.clip(applied) != applied:
            raise PlanError(
                f"pushes: {entry!r:.40} is beyond what the simulator takes from an operator"
            )
        if stamp_ns <= last_ns or stamp_ns not in stamps:
            raise PlanError(
                f"pushes: {stamp_ns!r:.40} is the stamp of no state, or not after the one before"
            )
        pushes.append((stamp_ns, applied))
    return tuple(pushes)
