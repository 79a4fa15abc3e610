"""A recorded run computed again: each command from the recorded states, each state from the commands.

The pure controller and simulation that the nodes drive are driven by the record; a change of parameters
or a reset takes effect where the record says that it did. After a difference the record's value is
taken on, so that one altered value shows as one.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from trunk_control.controller import hip_index, hip_seen
from trunk_msgs_util import topics
from trunk_msgs_util.declarations import build
from trunk_msgs_util.recording import Recording
from trunk_sim.disturbances import Disturbance, disturbance_at, disturbance_sample
from trunk_sim.plant import PlantState
from trunk_sim.simulation import DivergedError, Simulation

from .bits import same
from .nodes import NODES, make_controller
from .timeline import Timeline, changes_of


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


def replay_controller(recording: Recording, node: str) -> Iterator[tuple[int, list[Difference]]]:
    """Yield, for each recorded command, its stamp and what differs in it and in its terms.

    In real time the states that the controller acted on are those that its commands answer.
    """
    timeline = timeline_of(recording, node)
    config = timeline.config
    controller = make_controller(node, config)
    states = Messages(recording, topics.JOINT_STATES)
    commands = Messages(recording, topics.EFFORT_COMMAND)
    terms = Messages(recording, topics.controller_state(node))
    index, hip = states.names.index(config.joint), hip_index(config, states.names)
    from_topic = config.reference_profile == "topic"
    for stamp_ns in commands.stamps:
        if stamp_ns not in states:
            yield stamp_ns, [Difference(stamp_ns, topics.JOINT_STATES, "missing", 0.0, 0.0)]
            continue
        timeline.advance(stamp_ns, controller)
        positions, velocities = states.get(stamp_ns, "position"), states.get(stamp_ns, "velocity")
        position = positions[index]
        reference = terms.get(stamp_ns, "position")[0] if from_topic and stamp_ns in terms else None
        seen = hip_seen(hip, positions, velocities)
        answer = controller.update(stamp_ns, position, velocities[index], reference, seen)
        found = list(commands.compare(stamp_ns, "effort", (answer.effort,)))
        if answer.terms is not None and stamp_ns in terms:
            values = (answer.reference, position, *answer.terms)
            found += terms.compare(stamp_ns, "position", values)
        yield stamp_ns, found


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
    truth = Messages(recording, topics.GROUND_TRUTH)
    measured = Messages(recording, topics.JOINT_STATES)
    commands = Messages(recording, topics.EFFORT_COMMAND)
    disturbances = Messages(recording, topics.DISTURBANCE)
    for stamp_ns in truth.stamps:
        acting = _acting(disturbances, stamp_ns)
        found: list[Difference] = []
        sample = simulation.truth()
        for quantity in ("position", "velocity", "effort"):
            found += truth.compare(stamp_ns, quantity, getattr(sample, quantity))
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
