"""A recorded run computed again: each command from the recorded states, each state from the commands.

The pure controller and simulation that the nodes drive are driven by the record; a change of parameters
or a reset takes effect where the record says that it did. After a difference the record's value is
taken on, so that one altered value shows as one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from trunk_control.controller import Answer, Seen, hip_index, hip_seen
from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import build
from trunk_msgs_util.recording.reader import Recording
from trunk_sim.disturbances import Disturbance, disturbance_at, disturbance_sample
from trunk_sim.plant import PlantState
from trunk_sim.simulation import DivergedError, Simulation

from ..plans.nodes import NODES, make_controller
from ..plans.timeline import Timeline, begins_active, changes_of
from .bits import same

ACTIVE_CONTROLLERS = "active controllers"


class Difference(NamedTuple):
    """One value that the record has and the computation does not."""

    stamp_ns: int
    topic: str
    field: str
    recorded: float
    computed: float


class Messages:
    """A JointState topic by stamp: plain floats, quick to look up one by one."""

    def __init__(self, recording: Recording, relative: str) -> None:
        self.topic = relative
        arrays = recording.joints(recording.topic(relative))
        self.names = arrays.names
        self.stamps: list[int] = arrays.stamp_ns.tolist()
        self._rows: dict[str, list[list[float]]] = {
            quantity: getattr(arrays, quantity).tolist()
            for quantity in ("position", "velocity", "effort")
        }
        self._index = {stamp: i for i, stamp in enumerate(self.stamps)}

    def __contains__(self, stamp_ns: int) -> bool:
        return stamp_ns in self._index

    def __len__(self) -> int:
        return len(self.stamps)

    def get(self, stamp_ns: int, quantity: str) -> list[float]:
        """Return a message's values of a quantity; KeyError where the stamp is not there."""
        return self._rows[quantity][self._index[stamp_ns]]

    def compare(
        self, stamp_ns: int, quantity: str, computed: tuple[float, ...]
    ) -> Iterator[Difference]:
        """Yield each value of a message whose bits are not the computed ones."""
        for name, was, now in zip(self.names, self.get(stamp_ns, quantity), computed, strict=True):
            if not same(was, now):
                yield Difference(stamp_ns, self.topic, f"{quantity}[{name}]", was, now)


def config_of(recording: Recording, node: str) -> Any:
    """Return a node's configuration at the start. Raises KeyError where it was not recorded."""
    return build(NODES[node].config, recording.parameters()[recording.topic(node)])


def timeline_of(recording: Recording, node: str) -> Timeline:
    """Return a node's configuration at the start and what became of it."""
    return Timeline(config_of(recording, node), changes_of(recording, node))


class DrivenController:
    """A recorded controller, driven by its record: by the states, changes and turns that it had."""

    def __init__(self, recording: Recording, node: str) -> None:
        """Raise KeyError where its parameters were not recorded."""
        self._states = Messages(recording, topics.JOINT_STATES)
        self.terms = Messages(recording, topics.controller_state(node))
        config, changes = config_of(recording, node), changes_of(recording, node)
        self.timeline = Timeline(config, changes, self._seen)
        self.controller = make_controller(node, config)
        if not begins_active(config, changes):
            self.controller.deactivate()
        self._index = self._states.names.index(config.joint)
        self._hip = hip_index(config, self._states.names)

    def _seen(self, stamp_ns: int) -> Seen | None:
        if stamp_ns not in self._states:
            return None
        return Seen(stamp_ns, self._states.get(stamp_ns, "position")[self._index])

    def state(self, stamp_ns: int) -> tuple[float, float] | None:
        """Return the measured angle and rate at a stamp; None where that state was not recorded."""
        if stamp_ns not in self._states:
            return None
        position, velocity = (self._states.get(stamp_ns, q) for q in ("position", "velocity"))
        return position[self._index], velocity[self._index]

    def turn(self, stamp_ns: int) -> bool:
        """Come to a stamp; return True where the controller is active there."""
        self.timeline.advance(stamp_ns, self.controller)
        return self.controller.active

    def answer(self, stamp_ns: int) -> Answer:
        """Return the active controller's answer to a recorded state."""
        positions, velocities, efforts = (
            self._states.get(stamp_ns, q) for q in ("position", "velocity", "effort")
        )
        told = None
        if self.timeline.config.reference_profile == "topic" and stamp_ns in self.terms:
            told = self.terms.get(stamp_ns, "position")[0]
        return self.controller.update(
            stamp_ns,
            positions[self._index],
            velocities[self._index],
            told,
            hip_seen(self._hip, positions, velocities),
            efforts[self._index],
        )


def in_turn(stamps: Sequence[int], controllers: Sequence[str]) -> Sequence[int]:
    """Return the stamps of commands in their order; of several publishers a file keeps none."""
    return sorted(stamps) if len(controllers) > 1 else stamps


def replay_controllers(
    recording: Recording, nodes: Sequence[str]
) -> Iterator[tuple[str, int, list[Difference]]]:
    """Yield, for each recorded command, who was to give it, its stamp, and what differs.

    In real time the states that a controller acted on are those that its commands answer.
    """
    driven = {node: DrivenController(recording, node) for node in nodes}
    commands = Messages(recording, topics.EFFORT_COMMAND)
    for stamp_ns in in_turn(commands.stamps, nodes):
        active = [node for node, one in driven.items() if one.turn(stamp_ns)]
        if len(active) != 1:
            count = float(len(active))
            yield "", stamp_ns, [Difference(stamp_ns, "", ACTIVE_CONTROLLERS, count, 1.0)]
            continue
        yield active[0], stamp_ns, _compared(commands, driven[active[0]], stamp_ns)


def _compared(commands: Messages, driven: DrivenController, stamp_ns: int) -> list[Difference]:
    state = driven.state(stamp_ns)
    if state is None:
        return [Difference(stamp_ns, topics.JOINT_STATES, "missing", 0.0, 0.0)]
    answer = driven.answer(stamp_ns)
    found = list(commands.compare(stamp_ns, "effort", (answer.effort,)))
    if answer.terms is not None and stamp_ns in driven.terms:
        values = (answer.reference, state[0], *answer.terms)
        found += driven.terms.compare(stamp_ns, "position", values)
    return found


def replay_disturbance(recording: Recording) -> Iterator[tuple[int, list[Difference]]]:
    """Yield, for each recorded disturbance, its stamp and what differs in it."""
    timeline = timeline_of(recording, "disturbance")
    signals, joints = timeline.config.signals, timeline.config.joints
    messages = Messages(recording, topics.DISTURBANCE)
    for stamp_ns in messages.stamps:
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        sample = disturbance_sample(stamp_ns, joints, disturbance_at(stamp_ns, signals))
        yield (
            stamp_ns,
            [
                *messages.compare(stamp_ns, "position", sample.position),
                *messages.compare(stamp_ns, "effort", sample.effort),
            ],
        )


def replay_plant(recording: Recording) -> Iterator[tuple[int, list[Difference]]]:
    """Yield, for each recorded true state, its stamp and what differs in it and its measurement.

    For lock-step and offline runs, in which the torque over a step is the command that answers its
    first state.
    """
    timeline = timeline_of(recording, "simulator")
    simulation = Simulation(timeline.config)
    fell = {event.stamp_ns for event in recording.events() if event.message == "fell"}
    marked = "fall.angle" in recording.parameters()[recording.topic("simulator")]
    truth = Messages(recording, topics.GROUND_TRUTH)
    measured = Messages(recording, topics.JOINT_STATES)
    commands = Messages(recording, topics.EFFORT_COMMAND)
    disturbances = Messages(recording, topics.DISTURBANCE)
    timeline.advance(0, simulation)  # what came before the first state acts on it
    for stamp_ns in truth.stamps:
        acting = _acting(disturbances, stamp_ns)
        found: list[Difference] = []
        sample = simulation.truth()
        for quantity in ("position", "velocity", "effort"):
            found += truth.compare(stamp_ns, quantity, getattr(sample, quantity))
        if marked and simulation.falls_now != (stamp_ns in fell):
            mark = float(stamp_ns in fell)
            found.append(Difference(stamp_ns, topics.RUN_EVENTS, "fell", mark, 1.0 - mark))
        if found:
            _take_on(simulation, truth, stamp_ns)
        if stamp_ns in measured:
            seen = simulation.measure(acting)
            for quantity in ("position", "velocity", "effort"):
                found += measured.compare(stamp_ns, quantity, getattr(seen, quantity))
        yield stamp_ns, found
        if stamp_ns in commands:
            # A change stamped k came while state k was the newest: it acts on the step to k + 1.
            timeline.advance(stamp_ns + 1, simulation)
            try:
                simulation.step(commands.get(stamp_ns, "effort")[0], acting)
            except DivergedError:
                return


def _acting(disturbances: Messages, stamp_ns: int) -> Disturbance:
    if stamp_ns not in disturbances:
        return Disturbance()
    force, torque = disturbances.get(stamp_ns, "effort")
    hip, trunk = disturbances.get(stamp_ns, "position")
    return Disturbance(force, torque, hip, trunk)


def _take_on(simulation: Simulation, truth: Messages, stamp_ns: int) -> None:
    x, theta = truth.get(stamp_ns, "position")
    x_dot, theta_dot = truth.get(stamp_ns, "velocity")
    simulation.state = PlantState(x, theta, x_dot, theta_dot)
    simulation.applied_effort = truth.get(stamp_ns, "effort")[1]
