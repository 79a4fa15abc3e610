"""The offline run: simulation and controllers in one loop, the same functions that the nodes drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from trunk_control.controller import Answer, Seen, hip_index, hip_seen
from trunk_control.schedule import turn
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import seconds, step_count
from trunk_sim.disturbances import Disturbance, disturbance_at
from trunk_sim.simulation import Simulation

from ..plans.nodes import make_controller
from ..plans.plan import RunPlan
from ..plans.files import PlanError
from ..plans.timeline import Change, Timeline, begins_active


class Step(NamedTuple):
    """All that is said at one stamp."""

    stamp_ns: int
    truth: JointSample
    measured: JointSample
    acting: Disturbance
    controller: str  # who answers
    answer: Answer
    turned: tuple[
        tuple[str, bool], ...
    ]  # whom the schedule made active, or inactive, before the answer
    falls: bool  # with this state the trunk has fallen


@dataclass(frozen=True)
class Happenings:
    """What came from outside during a recorded run: changes by node, references [rad] by stamp."""

    changes: Mapping[str, Sequence[Change]] = field(default_factory=dict)
    references: Mapping[int, float] = field(default_factory=dict)

    def timeline(self, node: str, config: Any) -> Timeline:
        """Return a node's timeline."""
        return Timeline(config, self.changes.get(node, ()))


class _Participant:
    """A controller in an offline run: it follows every state, and answers in its turns."""

    def __init__(self, name: str, plan: RunPlan, outside: Happenings) -> None:
        config, joints = plan.controllers[name], plan.simulator.joints
        self.name = name
        self.controller = make_controller(name, config)
        changes = outside.changes.get(name, ())
        if not begins_active(config, changes):
            self.controller.deactivate()
        self._turns_ns = config.active_times_ns
        self._timeline = Timeline(config, changes, lambda _: self._seen)
        self._references = outside.references
        self._index = joints.index(config.joint)
        self._hip = hip_index(config, joints)
        self._seen: Seen | None = None

    def turn(self, stamp_ns: int) -> bool | None:
        """Come to a stamp; return what the schedule has made of the controller, None for nothing."""
        self._timeline.advance(stamp_ns, self.controller)
        before_ns = -1 if self._seen is None else self._seen.stamp_ns
        wanted = turn(self._turns_ns, before_ns, stamp_ns)
        if wanted is None or wanted == self.controller.active:
            return None
        if wanted:
            self.controller.activate(self._seen)
        else:
            self.controller.deactivate()
        return wanted

    def answer(self, measured: JointSample) -> Answer | None:
        """Return the answer to a state; None out of turn."""
        stamp_ns, position = measured.stamp_ns, measured.position[self._index]
        self._seen = Seen(stamp_ns, position)
        if not self.controller.active:
            return None
        return self.controller.update(
            stamp_ns,
            position,
            measured.velocity[self._index],
            self._references.get(stamp_ns),
            hip_seen(self._hip, measured.position, measured.velocity),
            measured.effort[self._index],
        )


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
    participants = [_Participant(name, plan, outside) for name in plan.controllers]
    disturbances = disturbance_source(plan, outside)
    last = step_count(simulator.duration, simulator.update_rate)
    of_simulator.advance(0, simulation)  # what came before the first state acts on it
    while True:
        stamp_ns = simulation.stamp_ns
        acting = disturbances(stamp_ns)
        measured = simulation.measure(acting)
        turned = tuple(
            (one.name, active) for one in participants if (active := one.turn(stamp_ns)) is not None
        )
        answers = [(one.name, given) for one in participants if (given := one.answer(measured))]
        if len(answers) != 1:
            raise PlanError(
                f"{len(answers)} controllers are active at t = {seconds(stamp_ns):g} s: "
                "one at a time is needed, at each time; see active.times"
            )
        ((name, answer),) = answers
        truth, falls = simulation.truth(), simulation.falls_now
        yield Step(stamp_ns, truth, measured, acting, name, answer, turned, falls)
        of_simulator.advance(stamp_ns + 1, simulation)
        if simulation.step_index == last or simulation.ended_by_fall:
            return
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
