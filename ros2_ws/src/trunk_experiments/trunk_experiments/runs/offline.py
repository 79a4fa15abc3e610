"""What an offline run asks of its plan, and the disturbance in it."""

from __future__ import annotations

from collections.abc import Callable

from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value
from trunk_sim.disturbances import Disturbance, disturbance_at

from ..errors import PlanError
from ..plans.plan import RunPlan, check_joints


def check(plan: RunPlan) -> None:
    """Raise PlanError for a plan that cannot be run without a graph.

    It needs an end, and nobody can publish references or activate a controller.
    """
    check_joints(plan)
    if not plan.simulator.duration:
        raise PlanError("simulator: duration is 0: an offline run needs an end; set it in s")
    for name, config in plan.controllers.items():
        changes = plan.changes.get(name, ())
        profiles: list[Value | None] = [config.reference_profile]
        profiles += [(change.values or {}).get("reference.profile") for change in changes]
        if "topic" in profiles and not plan.references:
            raise PlanError(
                f"{name}: reference.profile is 'topic', but nobody publishes references to an offline "
                "run: give another profile, or run the graph"
            )
        activated = any(change.event == Event.ACTIVATED for change in changes)
        if not (config.autostart or config.active_times or activated):
            raise PlanError(
                f"{name}: autostart is false, but nobody activates it in an offline run: "
                "set it to true, or run the graph"
            )


def disturbance_source(plan: RunPlan) -> Callable[[int], Disturbance]:
    """Return a function that returns the acting disturbance; its stamps must increase."""
    if plan.disturbance is None:
        quiet = Disturbance()
        return lambda stamp_ns: quiet
    timeline = plan.timeline("disturbance")
    signals = plan.disturbance.signals

    def acting(stamp_ns: int) -> Disturbance:
        nonlocal signals
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        return disturbance_at(stamp_ns, signals)

    return acting
