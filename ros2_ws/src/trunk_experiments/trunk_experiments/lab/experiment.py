"""An experiment that a lab has saved: the page's parameters, what is changed, and what came of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trunk_core.errors import PlanError, TrunkError
from trunk_core.parameters.parameter_files import Layer, Section
from trunk_evidence.branching import with_settings
from trunk_runs.engine import TERMS, States, states_of_run
from trunk_runs.loop import check_compilable, states_of
from trunk_runs.offline_recording import Progress, record_states
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.timeline import Pushes
from trunk_sim.inputs import Applied
from trunk_sim.simulation import DivergedError

FORMAT = "trunk experiment 2"
_KEYS: Mapping[str, tuple[type, ...]] = {
    "format": (str,),
    "scenario": (str,),
    "controller": (str,),
    "page": (str,),
    "parameters": (dict,),  # of the page
    "values": (dict,),  # that are other than the page's
    "branch": (dict, type(None)),
    "pushes": (list,),
    "states": (int,),
    "sha256": (str, type(None)),
}
NO_LINKS = "a lab has no messages that are late or lost, and no measurements that fail"
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
        raise PlanError(f"simulator: {NO_LINKS}: leave out link.* and sensor.dropout")
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
    name = data["controller"]
    for key in ("scenario", "controller", "page"):
        if len(data[key]) > _LONGEST or not data[key].isprintable():
            raise PlanError(f"{key} is not a line of at most {_LONGEST} characters")
    if not {"simulator", name} <= data["parameters"].keys():
        raise PlanError(f"parameters: those of simulator and {name} are needed")
    sections = *_sections(data["parameters"]), *_sections(data["values"])
    plan = make_plan(Layer(data["scenario"], sections), name)
    check_plan(plan)
    plan = replace(plan, pushes=_pushes(data["pushes"], plan))
    if data["branch"] is not None:
        disturbance = [section for section in sections if section.pattern == "disturbance"]
        plan = _branched(plan, data["branch"], disturbance)
    return Experiment(plan, data["states"], data["sha256"] or "", data["page"])


def _branched(plan: RunPlan, branch: Any, disturbance: Sequence[Section]) -> RunPlan:
    """Return the plan with what a branch changes; a disturbance that did nothing begins with it."""
    at_ns, values = branch.get("at_ns"), branch.get("values")
    if branch.keys() != {"at_ns", "values"} or not isinstance(values, dict):
        raise PlanError("branch: at_ns and values are needed")
    if type(at_ns) is not int or at_ns not in _stamps(plan):
        raise PlanError(f"branch: at_ns {str(at_ns)[:40]} is the stamp of no state")
    nodes = values.keys() & {"simulator", "disturbance", *plan.controllers}
    sections = [s for s in (*disturbance, *_sections(values)) if s.pattern in nodes]
    return with_settings(plan, at_ns, [Layer("branch", sections)])


def _sections(parameters: Mapping[str, Any]) -> list[Section]:
    for node, values in parameters.items():
        if not isinstance(values, dict):
            raise PlanError(f"parameters of {node[:40]} are of another type")
    return [
        Section(node, {name: _value(value) for name, value in values.items()})
        for node, values in parameters.items()
    ]


def _value(value: Any) -> Any:
    """Return a value as parameter files have it: JSON has no infinities, they are texts."""
    if isinstance(value, list):
        return tuple(map(_value, value))
    return float(value) if value in ("inf", "-inf") else value


def _stamps(plan: RunPlan) -> range:
    period_ns = plan.simulator.period_ns
    return range(0, states_of(plan) * period_ns, period_ns)


def _pushes(listed: list[Any], plan: RunPlan) -> Pushes:
    limits, stamps = plan.simulator.operator_limits, _stamps(plan)
    pushes: list[tuple[int, Applied]] = []
    for entry in listed:
        kinds = list(map(type, entry)) if isinstance(entry, list) else []
        if len(kinds) != 3 or kinds[0] is not int or not {*kinds} <= {int, float}:
            raise PlanError(f"pushes: {entry!r:.40}: a stamp in ns, N and N m are needed")
        stamp_ns, applied = entry[0], Applied(*map(float, entry[1:]))
        if limits is None or limits.clip(applied) != applied:
            raise PlanError(f"pushes: {entry!r:.40} is beyond the operator's limits")
        if stamp_ns not in stamps or (pushes and stamp_ns <= pushes[-1][0]):
            raise PlanError(
                f"pushes: {stamp_ns!r:.40} is the stamp of no state, or not after the one before"
            )
        pushes.append((stamp_ns, applied))
    return tuple(pushes)
