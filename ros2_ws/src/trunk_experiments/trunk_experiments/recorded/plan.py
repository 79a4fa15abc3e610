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
    if reason := why_not_again(run):
        raise RecordingError(f"{run.path}: it cannot be run again: {reason}")
    controllers, states = run.controllers, run.count(topics.GROUND_TRUTH)
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
        pushes=run.operated.pushes,
    )


def why_not_again(run: RecordedRun) -> str:
    """Return why a recorded run cannot be run again with the same bits; empty if it can be."""
    if reason := run.cannot_be_recomputed():
        return reason
    states = run.count(topics.GROUND_TRUTH)
    if run.recording.damage and not states:
        return run.recording.damage[0]
    if not run.controllers or not set(run.controllers) <= set(usable()):
        return unknown_controllers(run.controllers) or "no controller was recorded"
    missing = {*run.controllers, "simulator"} - set(run.parameters)
    if missing:
        return f"no parameters of {', '.join(sorted(missing))} recorded"
    return "" if states else "no true states recorded"


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
