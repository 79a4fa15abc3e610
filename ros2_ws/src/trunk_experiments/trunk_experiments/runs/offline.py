"""The offline run: simulation and controllers in one loop, the same functions that the nodes drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from trunk_control.controller import Controller, hip_index, hip_seen
from trunk_control.decide import Answer, Reading
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import nanoseconds, seconds, step_count
from trunk_sim.disturbances import Disturbance, disturbance_at
from trunk_sim.operator_input import with_operator
from trunk_sim.quick import Act
from trunk_sim.simulation import Simulation
from trunk_sim.step import in_force

from ..errors import PlanError
from ..plans.operated import Operated
from ..plans.plan import RunPlan, check_joints
from ..plans.timeline import begins_active


class Step(NamedTuple):
    """All messages of one stamp."""

    stamp_ns: int
    truth: JointSample
    measured: JointSample
    acting: Disturbance
    controller: str  # the controller that answers; empty: none
    answer: Answer | None
    turned: tuple[
        tuple[str, bool], ...
    ]  # made active or inactive by the schedule, before the answer
    falls: bool  # the trunk fell in this state


class Begun(NamedTuple):
    """A run before one of its states: where `steps` begins, or goes on.

    ``effort`` [N m] and ``told_ns`` are the last command and its stamp.
    """

    simulation: Simulation
    controllers: Mapping[str, Controller]
    told_ns: int = 0
    effort: float = 0.0
    by_hand: bool = False  # at times no controller may be active


def begun(plan: RunPlan, act: Act | None = None) -> Begun:
    """Return a plan's run before its first state; ``act`` is that of the `Simulation`."""
    controllers = {name: Controller(config) for name, config in plan.controllers.items()}
    for name, controller in controllers.items():
        if not begins_active(plan.controllers[name], plan.changes.get(name, ())):
            controller.deactivate()
    simulation = Simulation(plan.simulator, act)
    plan.timeline("simulator").advance(0, simulation)  # changes before the first state act on it
    # Only a recorded run has a gap between two controllers: its last command counts until it is too old.
    by_hand = any(plan.changes.get(name) for name in plan.controllers)
    return Begun(simulation, controllers, by_hand=by_hand)


class _Participant:
    """A controller in an offline run: it follows every state, and answers in its turns."""

    def __init__(self, name: str, controller: Controller, plan: RunPlan) -> None:
        config, joints = plan.controllers[name], plan.simulator.joints
        self.name = name
        self.controller = controller
        self._timeline = plan.timeline(name)
        self._references = plan.references
        self._index = joints.index(config.joint)
        self._hip = hip_index(config, joints)

    def decide(self, measured: JointSample) -> tuple[Answer, bool]:
        """Return the answer to a state, and True if the schedule switched the controller before it."""
        stamp_ns = measured.stamp_ns
        self._timeline.advance(stamp_ns, self.controller)
        before = self.controller.active
        told = self._references.get(stamp_ns)
        answer = self.controller.decide(
            Reading(
                stamp_ns,
                measured.position[self._index],
                measured.velocity[self._index],
                hip_seen(self._hip, measured.position, measured.velocity),
                measured.effort[self._index],
                told is not None,
                0.0 if told is None else told,
            )
        )
        return answer, answer.active != before


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


def steps(plan: RunPlan, act: Act | None = None) -> Iterator[Step]:
    """Yield the N + 1 steps of a run; ``act`` is that of the `Simulation`.

    If no controller was active for a while in a run that is repeated, the plant holds the last command until
    it is too old, as in real time. Raises PlanError for a plan that cannot be run offline (`check`),
    DivergedError (after the last finite step) if the loop is unstable.
    """
    check(plan)
    yield from steps_from(plan, begun(plan, act))


def steps_from(plan: RunPlan, begin: Begun, stop: int = -1) -> Iterator[Step]:
    """Yield the steps of a run from a state on, whose nodes ``begin`` holds. Raises as `steps` does.

    The plan has the configurations in force at that state, and what changes from it on. The nodes stay
    before the state with the index ``stop``, if the run reaches it.
    """
    simulator, simulation = plan.simulator, begin.simulation
    of_simulator = plan.timeline("simulator")
    participants = [_Participant(name, one, plan) for name, one in begin.controllers.items()]
    disturbances, operated = (
        disturbance_source(plan),
        Operated(plan.pushes, simulator.operator_limits),
    )
    last = step_count(simulator.duration, simulator.update_rate)
    of_simulator.advance(simulation.stamp_ns)  # `begin` has them
    told_ns, effort, by_hand = begin.told_ns, begin.effort, begin.by_hand
    while simulation.step_index != stop:
        stamp_ns = simulation.stamp_ns
        acting = disturbances(stamp_ns)
        measured = simulation.measure(acting)
        decided = [(one.name, *one.decide(measured)) for one in participants]
        turned = tuple((name, answer.active) for name, answer, turns in decided if turns)
        answers = [(name, answer) for name, answer, _ in decided if answer.active]
        if len(answers) != 1 and (answers or not by_hand):
            raise PlanError(
                f"{len(answers)} controllers are active at t = {seconds(stamp_ns):g} s: "
                "exactly one must act at any time; see active.times"
            )
        name, answer = answers[0] if answers else ("", None)
        if answer is not None:
            told_ns, effort = stamp_ns, answer.effort
        truth, falls = simulation.truth(), simulation.falls_now
        yield Step(stamp_ns, truth, measured, acting, name, answer, turned, falls)
        of_simulator.advance(stamp_ns + 1, simulation)
        if simulation.step_index == last or simulation.ended_by_fall:
            return
        timeout_ns = nanoseconds(of_simulator.config.command_timeout)
        held = in_force(effort, stamp_ns - told_ns, timeout_ns)
        simulation.step(held, with_operator(acting, operated.at(stamp_ns)))


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
