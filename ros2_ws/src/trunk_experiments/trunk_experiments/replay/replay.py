"""A recorded run computed again: each command from the recorded states, each state from the commands.

The pure controller and simulation that the nodes drive are driven by the record; a change of parameters
or a reset takes effect where the record says that it did. After a difference the record's value is
taken on, so that one altered value shows as one. Long stretches in which all is equal are passed over by
compiled code (`stretches`); what is not equal there is looked at here, step by step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from trunk_control.controller import Controller, hip_index, hip_seen
from trunk_control.decide import Answer, Reading, state_record
from trunk_msgs_util import topics
from trunk_sim.disturbances import Disturbance, disturbance_at, disturbance_sample
from trunk_sim.plant import PlantState
from trunk_sim.simulation import DivergedError, Simulation

from ..plans.timeline import Timeline, begins_active
from .bits import same
from .record import JointTable, RecordedRun

ACTIVE_CONTROLLERS = "active controllers"


class Difference(NamedTuple):
    """One value that the record has and the computation does not."""

    stamp_ns: int
    topic: str
    field: str
    recorded: float
    computed: float


class Checked(NamedTuple):
    """Steps of a replay: one, with what differs in it, or many in which nothing does."""

    stamp_ns: int  # of the first
    found: Sequence[Difference]
    steps: int = 1
    controller: str = ""  # who was to give the command; empty: not exactly one


def compare(
    table: JointTable, stamp_ns: int, quantity: str, computed: Sequence[float]
) -> Iterator[Difference]:
    """Yield each value of a message whose bits are not the computed ones."""
    recorded = table.get(stamp_ns, quantity)
    for name, was, now in zip(table.names, recorded, computed, strict=True):
        if not same(was, now):
            yield Difference(stamp_ns, table.topic, f"{quantity}[{name}]", was, now)


class DrivenController:
    """A recorded controller, driven by its record: by the states, changes and turns that it had."""

    def __init__(self, run: RecordedRun, node: str) -> None:
        """Raise KeyError where its parameters were not recorded."""
        self.states = run.table(topics.JOINT_STATES)
        self.terms = run.table(topics.controller_state(node))
        config, changes = run.config(node), run.changes(node)
        self.timeline = Timeline(config, changes, self._seen)
        self.controller = Controller(config)
        if not begins_active(config, changes):
            self.controller.deactivate()
        self.joint = self.states.names.index(config.joint)
        self.hip = hip_index(config, self.states.names)

    def _seen(self, stamp_ns: int) -> float | None:
        if stamp_ns not in self.states:
            return None
        return self.states.get(stamp_ns, "position")[self.joint]

    def state(self, stamp_ns: int) -> tuple[float, float] | None:
        """Return the measured angle and rate at a stamp; None where that state was not recorded."""
        if stamp_ns not in self.states:
            return None
        position, velocity = (self.states.get(stamp_ns, q) for q in ("position", "velocity"))
        return position[self.joint], velocity[self.joint]

    def turn(self, stamp_ns: int) -> bool:
        """Come to a stamp; return True where the controller is active there."""
        self.timeline.advance(stamp_ns, self.controller)
        return self.controller.active

    def answer(self, stamp_ns: int) -> Answer:
        """Return the active controller's answer to a recorded state."""
        positions, velocities, efforts = (
            self.states.get(stamp_ns, q) for q in ("position", "velocity", "effort")
        )
        told = stamp_ns in self.terms
        return self.controller.decide(
            Reading(
                stamp_ns,
                positions[self.joint],
                velocities[self.joint],
                hip_seen(self.hip, positions, velocities),
                efforts[self.joint],
                told,
                self.terms.get(stamp_ns, "position")[0] if told else 0.0,
            )
        )


def in_turn(stamps: Sequence[int], controllers: Sequence[str]) -> Sequence[int]:
    """Return the stamps of commands in their order; of several publishers a file keeps none."""
    return sorted(stamps) if len(controllers) > 1 else stamps


def replay_controllers(run: RecordedRun, nodes: Sequence[str]) -> Iterator[Checked]:
    """Yield what differs in each recorded command, and in its terms.

    In real time the states that a controller acted on are those that its commands answer.
    """
    driven = {node: DrivenController(run, node) for node in nodes}
    commands = run.table(topics.EFFORT_COMMAND)
    for stamp_ns in in_turn(commands.stamps, nodes):
        active = [node for node, one in driven.items() if one.turn(stamp_ns)]
        if len(active) != 1:
            count = float(len(active))
            yield Checked(stamp_ns, [Difference(stamp_ns, "", ACTIVE_CONTROLLERS, count, 1.0)])
            continue
        found = _compared(commands, driven[active[0]], stamp_ns)
        yield Checked(stamp_ns, found, controller=active[0])


def _compared(commands: JointTable, driven: DrivenController, stamp_ns: int) -> list[Difference]:
    state = driven.state(stamp_ns)
    if state is None:
        return [Difference(stamp_ns, topics.JOINT_STATES, "missing", 0.0, 0.0)]
    answer = driven.answer(stamp_ns)
    found = list(compare(commands, stamp_ns, "effort", (answer.effort,)))
    if answer.fresh and stamp_ns in driven.terms:
        record = state_record(answer, state[0])
        found += compare(driven.terms, stamp_ns, "position", record)
    return found


def replay_disturbance(run: RecordedRun) -> Iterator[Checked]:
    """Yield what differs in each recorded disturbance."""
    timeline = run.timeline("disturbance")
    signals, joints = timeline.config.signals, timeline.config.joints
    messages = run.table(topics.DISTURBANCE)
    for stamp_ns in messages.stamps:
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        sample = disturbance_sample(stamp_ns, joints, disturbance_at(stamp_ns, signals))
        found = [
            *compare(messages, stamp_ns, "position", sample.position),
            *compare(messages, stamp_ns, "effort", sample.effort),
        ]
        yield Checked(stamp_ns, found)


def replay_plant(run: RecordedRun) -> Iterator[Checked]:
    """Yield what differs in each recorded true state and in its measurement.

    For lock-step and offline runs, in which the torque over a step is the command that answers its
    first state.
    """
    timeline = run.timeline("simulator")
    simulation = Simulation(timeline.config)
    fell = {event.stamp_ns for event in run.events if event.message == "fell"}
    marked = "fall.angle" in run.parameters["simulator"]
    truth = run.table(topics.GROUND_TRUTH)
    measured = run.table(topics.JOINT_STATES)
    commands = run.table(topics.EFFORT_COMMAND)
    disturbances = run.table(topics.DISTURBANCE)
    timeline.advance(0, simulation)  # what came before the first state acts on it
    for stamp_ns in truth.stamps:
        acting = acting_at(disturbances, stamp_ns)
        found: list[Difference] = []
        sample = simulation.truth()
        for quantity in ("position", "velocity", "effort"):
            found += compare(truth, stamp_ns, quantity, getattr(sample, quantity))
        if marked and simulation.falls_now != (stamp_ns in fell):
            mark = float(stamp_ns in fell)
            found.append(Difference(stamp_ns, topics.RUN_EVENTS, "fell", mark, 1.0 - mark))
        if found:
            _take_on(simulation, truth, stamp_ns)
        if stamp_ns in measured:
            seen = simulation.measure(acting)
            for quantity in ("position", "velocity", "effort"):
                found += compare(measured, stamp_ns, quantity, getattr(seen, quantity))
        yield Checked(stamp_ns, found)
        if stamp_ns in commands:
            # A change stamped k came while state k was the newest: it acts on the step to k + 1.
            timeline.advance(stamp_ns + 1, simulation)
            try:
                simulation.step(commands.get(stamp_ns, "effort")[0], acting)
            except DivergedError:
                return


def acting_at(disturbances: JointTable, stamp_ns: int) -> Disturbance:
    """Return what the record says disturbed at a stamp; nothing where there is no message."""
    if stamp_ns not in disturbances:
        return Disturbance()
    force, torque = disturbances.get(stamp_ns, "effort")
    hip, trunk = disturbances.get(stamp_ns, "position")
    return Disturbance(force, torque, hip, trunk)


def _take_on(simulation: Simulation, truth: JointTable, stamp_ns: int) -> None:
    x, theta = truth.get(stamp_ns, "position")
    x_dot, theta_dot = truth.get(stamp_ns, "velocity")
    simulation.take_on(PlantState(x, theta, x_dot, theta_dot), truth.get(stamp_ns, "effort")[1])
