"""A recorded run's plan, from the recording alone: what ``trunk simulate --like`` runs again."""

from __future__ import annotations

from dataclasses import replace

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS
from ..plans.plan import RunPlan
from ..plans.timeline import changes_of
from ..runs.offline import Happenings
from .replay import Messages, config_of


def plan_like(recording: Recording) -> tuple[RunPlan, Happenings]:
    """Return the plan of a recorded run, as many steps as were recorded, and what happened in it.

    Raises RecordingError where the recording does not hold what it takes.
    """
    controllers = recording.controllers
    if not controllers or not set(controllers) <= set(CONTROLLERS):
        raise RecordingError(
            f"{recording.path}: no controller of {', '.join(CONTROLLERS)} was recorded: "
            "it cannot be run again"
        )
    states = recording.topics[recording.topic(topics.GROUND_TRUTH)].count
    recorded = {name.rsplit("/", 1)[-1] for name in recording.parameters()}
    missing = {*controllers, "simulator"} - recorded
    if missing or not states:
        what = f"parameters of {', '.join(sorted(missing))}" if missing else "true states"
        raise RecordingError(f"{recording.path}: no {what} recorded: it cannot be run again")
    disturbance = config_of(recording, "disturbance") if "disturbance" in recorded else None
    simulator = config_of(recording, "simulator")
    plan = RunPlan(
        scenario=recording.provenance.get("scenario", ""),
        controller_name=controllers[0],
        simulator=replace(simulator, duration=seconds((states - 1) * simulator.period_ns)),
        controller=config_of(recording, controllers[0]),
        successors={name: config_of(recording, name) for name in controllers[1:]},
        disturbance=disturbance,
        recorder=RecorderConfig(controllers=tuple(controllers)),
    )
    changes = {name: changes_of(recording, name) for name in plan.configs}
    return plan, Happenings(
        {name: found for name, found in changes.items() if found}, _references(recording, plan)
    )


def _references(recording: Recording, plan: RunPlan) -> dict[int, float]:
    """Return the references that came by topic: no parameter holds them."""
    found: dict[int, float] = {}
    for name, config in plan.controllers.items():
        if config.reference_profile == "topic":
            terms = Messages(recording, topics.controller_state(name))
            found |= {stamp: terms.get(stamp, "position")[0] for stamp in terms.stamps}
    return found
