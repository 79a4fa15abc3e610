"""The plan of a recorded run: what `simulate --like` and other repeats run."""

from __future__ import annotations

from dataclasses import replace

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.units import seconds

from ..plans.nodes import unknown_controllers
from ..plans.plan import RunPlan
from .run import RecordedRun, usable


def plan_of(run: RecordedRun) -> RunPlan:
    """Return the plan of the recorded run, as many steps as were recorded, and what happened in it.

    Raises RecordingError if the recording lacks something that this needs.
    """
    if reason := run.cannot_be_recomputed():
        raise RecordingError(f"{run.path}: {reason}")
    controllers = run.controllers
    if not controllers or not set(controllers) <= set(usable()):
        raise RecordingError(
            f"{run.path}: it cannot be run again: "
            f"{unknown_controllers(controllers) or 'no controller was recorded'}"
        )
    states = run.count(topics.GROUND_TRUTH)
    missing = {*controllers, "simulator"} - set(run.parameters)
    if missing or not states:
        what = f"parameters of {', '.join(sorted(missing))}" if missing else "true states"
        raise RecordingError(f"{run.path}: no {what} recorded: it cannot be run again")
    simulator = run.config("simulator")
    plan = RunPlan(
        scenario=run.recording.provenance.get("scenario", ""),
        simulator=replace(simulator, duration=seconds((states - 1) * simulator.period_ns)),
        controllers={name: run.config(name) for name in controllers},
        disturbance=run.config("disturbance") if "disturbance" in run.parameters else None,
        recorder=RecorderConfig(controllers=tuple(controllers)),
    )
    changes = {name: run.changes(name) for name in plan.configs}
    return replace(
        plan,
        changes={name: found for name, found in changes.items() if found},
        references=references_of(run),
    )


def references_of(run: RecordedRun) -> dict[int, float]:
    """Return the controllers' references that came by topic and are in no parameter."""
    found: dict[int, float] = {}
    for name in run.controllers:
        told = any(
            (change.values or {}).get("reference.profile") == "topic"
            for change in run.changes(name)
        )
        if told or run.config(name).reference_profile == "topic":
            terms = run.table(topics.controller_state(name))
            values = terms.values("position")
            if len(terms) and values.shape[1]:
                found |= dict(zip(terms.stamps, values[:, 0].tolist(), strict=True))
    return found
