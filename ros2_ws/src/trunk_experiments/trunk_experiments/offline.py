"""The offline run: simulation and controller in one loop, the same functions that the nodes drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from trunk_control.controller import Answer, hip_index, hip_seen
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import step_count
from trunk_sim.disturbances import Disturbance, disturbance_at
from trunk_sim.simulation import Simulation

from .nodes import make_controller
from .plan import PlanError, RunPlan
from .timeline import Change, Timeline


class Step(NamedTuple):
    """All that is said at one stamp."""

    stamp_ns: int
    truth: JointSample
    measured: JointSample
    acting: Disturbance
    answer: Answer


@dataclass(frozen=True)
class Happenings:
    """What came from outside during a recorded run: changes by node, references [rad] by stamp."""

    changes: Mapping[str, Sequence[Change]] = field(default_factory=dict)
    references: Mapping[int, float] = field(default_factory=dict)

    def timeline(self, node: str, config: Any) -> Timeline:
        """Return a node's timeline."""
        return Timeline(config, self.changes.get(node, ()))


def steps(plan: RunPlan, happenings: Happenings | None = None) -> Iterator[Step]:
    """Yield the N + 1 steps of a run, with ``happenings`` where it is one that was recorded.

    Raises PlanError for a plan without an end, DivergedError (after the last finite step) where the
    loop is unstable.
    """
    simulator = plan.simulator
    if not simulator.duration:
        raise PlanError("simulator: duration is 0: an offline run needs an end; set it in s")
    outside = happenings or Happenings()
    simulation = Simulation(simulator)
    of_simulator = outside.timeline("simulator", simulator)
    controller = make_controller(plan.controller_name, plan.controller)
    of_controller = outside.timeline(plan.controller_name, plan.controller)
    disturbances = disturbance_source(plan, outside)
    index = simulator.joints.index(plan.controller.joint)
    hip = hip_index(plan.controller, simulator.joints)
    last = step_count(simulator.duration, simulator.update_rate)
    for k in range(last + 1):
        stamp_ns = simulation.stamp_ns
        acting = disturbances(stamp_ns)
        measured = simulation.measure(acting)
        of_controller.advance(stamp_ns, controller)
        answer = controller.update(
            stamp_ns,
            measured.position[index],
            measured.velocity[index],
            outside.references.get(stamp_ns),
            hip_seen(hip, measured.position, measured.velocity),
        )
        yield Step(stamp_ns, simulation.truth(), measured, acting, answer)
        of_simulator.advance(stamp_ns + 1, simulation)
        if k < last:
            simulation.step(answer.effort, acting)


def disturbance_source(plan: RunPlan, outside: Happenings) -> Callable[[int], Disturbance]:
    """Return a function of rising stamps that says what acts."""
    if plan.disturbance is None:
        quiet = Disturbance()
        return lambda stamp_ns: quiet
    timeline = outside.timeline("disturbance", plan.disturbance)
    signals = plan.disturbance.signals

    def acting(stamp_ns: int) -> Disturbance:
        nonlocal signals
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        return disturbance_at(stamp_ns, signals)

    return acting
