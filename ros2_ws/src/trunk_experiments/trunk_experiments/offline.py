"""The offline run: simulation and controller in one loop, the same functions that the nodes drive."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from trunk_control.controller import Answer
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import step_count
from trunk_sim.disturbances import Disturbance, disturbance_at
from trunk_sim.simulation import Simulation

from .nodes import make_controller
from .plan import PlanError, RunPlan


class Step(NamedTuple):
    """All that is said at one stamp."""

    stamp_ns: int
    truth: JointSample
    measured: JointSample
    acting: Disturbance
    answer: Answer


def steps(plan: RunPlan) -> Iterator[Step]:
    """Yield the N + 1 steps of a run.

    Raises PlanError for a plan without an end, DivergedError (after the last finite step) where the
    loop is unstable.
    """
    simulator = plan.simulator
    if not simulator.duration:
        raise PlanError("simulator: duration is 0: an offline run needs an end; set it in s")
    simulation = Simulation(simulator)
    controller = make_controller(plan.controller_name, plan.controller)
    signals = None if plan.disturbance is None else plan.disturbance.signals
    index = simulator.joints.index(plan.controller.joint)
    last = step_count(simulator.duration, simulator.update_rate)
    quiet = Disturbance()
    for k in range(last + 1):
        stamp_ns = simulation.stamp_ns
        acting = quiet if signals is None else disturbance_at(stamp_ns, signals)
        measured = simulation.measure(acting)
        answer = controller.update(stamp_ns, measured.position[index], measured.velocity[index])
        yield Step(stamp_ns, simulation.truth(), measured, acting, answer)
        if k < last:
            simulation.step(answer.effort, acting)
