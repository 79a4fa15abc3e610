"""A run from one of its states on: by CPython while parameters change, then, if possible, by compiled code.

Both give the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from trunk_control.controller import Controller
from trunk_control.schedule import active_at
from trunk_sim.quick import worth_compiling
from trunk_sim.simulation import Simulation

from ..errors import PlanError
from ..plans.plan import RunPlan
from .offline import Begun, Step, steps_from
from .quick import compiled_states_from
from .states import States, in_stretches, longest


def states_from(plan: RunPlan, begun: Begun) -> Iterator[States]:
    """Yield the states of a run in their order, beginning with the one after ``begun``.

    Raises PlanError for a plan that cannot be run offline, DivergedError after the last finite state.
    """
    first, length = begun.simulation.step_index, longest(plan.simulator.substeps)
    changes = [change.stamp_ns for some in plan.changes.values() for change in some]
    # CPython also computes the state on which the last change takes effect.
    settled = max([first, *(stamp_ns // plan.simulator.period_ns + 2 for stamp_ns in changes)])
    if not (worth_compiling(plan.simulator, settled) and _known(plan)):
        yield from in_stretches(steps_from(plan, begun), length, first)
        return
    last = _Last(begun)
    yield from in_stretches(last.of(steps_from(plan, begun, settled)), length, first)
    if begun.simulation.step_index != settled:  # the run is over
        return
    try:
        rest = compiled_states_from(*_settled(plan, begun))
    except (ImportError, PlanError):
        rest = in_stretches(steps_from(plan, last.begun), length, settled)
    yield from rest


def _known(plan: RunPlan) -> bool:
    """Return False for a run with messages still to arrive: compiled code does not have them."""
    simulator = plan.simulator
    under_way = simulator.delay_steps or simulator.network is not None
    return not (under_way or plan.references or plan.pushes)


def _settled(plan: RunPlan, begun: Begun) -> tuple[RunPlan, dict[str, Controller], Simulation]:
    """Return the plan of the rest of a run in which nothing changes any more, and the nodes.

    Raises PlanError for turns that are not those of a schedule.
    """
    simulation = begun.simulation
    before_ns = simulation.stamp_ns - simulation.config.period_ns
    controllers = {}
    for name, one in begun.controllers.items():
        times = one.config.active_times_ns
        if one.active or times:  # the others never become active
            controllers[name] = one
        if times and one.active != active_at(times, before_ns if simulation.step_index else -1):
            raise PlanError(f"{name}: turns that are not those of active.times are not compiled")
    disturbance = None
    if plan.disturbance is not None:
        timeline = plan.timeline("disturbance")
        timeline.advance(simulation.stamp_ns)
        disturbance = timeline.config
    settled = replace(
        plan,
        simulator=replace(simulation.config, duration=plan.simulator.duration),
        controllers={name: one.config for name, one in controllers.items()},
        disturbance=disturbance,
        changes={},
    )
    return settled, controllers, simulation


class _Last:
    """Keeps the last command of some steps, so that others can go on."""

    def __init__(self, begun: Begun) -> None:
        self.begun = begun

    def of(self, steps: Iterator[Step]) -> Iterator[Step]:
        """Pass the steps on."""
        for step in steps:
            if step.answer is not None:
                self.begun = self.begun._replace(told_ns=step.stamp_ns, effort=step.answer.effort)
            yield step
