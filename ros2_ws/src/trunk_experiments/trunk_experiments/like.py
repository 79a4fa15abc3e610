"""A recorded run's plan, from the recording alone: what ``trunk simulate --like`` runs again."""

from __future__ import annotations

from dataclasses import replace

from trunk_msgs_util import topics
from trunk_msgs_util.config import RecorderConfig
from trunk_msgs_util.recording import Recording, RecordingError
from trunk_msgs_util.units import seconds

from .nodes import CONTROLLERS
from .offline import Happenings
from .plan import RunPlan
from .replay import Messages, config_of
from .timeline import changes_of


def plan_like(recording: Recording) -> tuple[RunPlan, Happenings]:
    """Return the plan of a recorded run, as many steps as were recorded, and what happened in it.

    Raises RecordingError where the recording does not hold what it takes.
    """
    controller = recording.controller
    if controller not in CONTROLLERS:
        raise RecordingError(
            f"{recording.path}: no controller of {', '.join(CONTROLLERS)} was recorded: "
            "it cannot be run again"
        )
    states = recording.topics[recording.topic(topics.GROUND_TRUTH)].count
    recorded = {name.rsplit("/", 1)[-1] for name in recording.parameters()}
    missing = {controller, "simulator"} - recorded
    if missing or not states:
        what = f"parameters of {', '.join(sorted(missing))}" if missing else "true states"
        raise RecordingError(f"{recording.path}: no {what} recorded: it cannot be run again")
    disturbance = config_of(recording, "disturbance") if "disturbance" in recorded else None
    simulator = config_of(recording, "simulator")
    plan = RunPlan(
        scenario=recording.provenance.get("scenario", ""),
        controller_name=controller,
        simulator=replace(simulator, duration=seconds((states - 1) * simulator.period_ns)),
        controller=config_of(recording, controller),
        disturbance=disturbance,
        recorder=RecorderConfig(controllers=(controller,)),
    )
    changes = {name: changes_of(recording, name) for name in plan.configs}
    return plan, Happenings(
        {name: found for name, found in changes.items() if found}, _references(recording, plan)
    )


def _references(recording: Recording, plan: RunPlan) -> dict[int, float]:
    """Return the references that came by topic: no parameter holds them."""
    if plan.controller.reference_profile != "topic":
        return {}
    terms = Messages(recording, topics.controller_state(plan.controller_name))
    return {stamp: terms.get(stamp, "position")[0] for stamp in terms.stamps}
