"""The node of any law: states in, effort commands and terms out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from math import isfinite

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from trunk_core import topics
from trunk_core.samples import JointSample, has_doubled
from trunk_core.text import quoted_names
from trunk_core.topics import Event
from trunk_core.units import seconds
from trunk_msgs_util.node import discovery, qos
from trunk_msgs_util.node.base import ENDING, TrunkNode
from trunk_msgs_util.node.conversions import WireReader, sample_to_wire
from trunk_msgs_util.node.endpoints import AdaptiveSubscription
from trunk_msgs_util.node.execution import run_nodes

from .controller import Controller, JointPlaces, hip_seen
from .decide import Output, Reading, state_record
from .law import ControllerConfig, Law
from .laws import law_named

OWN_REFERENCE = topics.own_reference("~")
# Under which names states are counted that the law cannot use.
NO_JOINT, NO_VELOCITY, NOT_FINITE, OUT_OF_ORDER = UNUSED_STATES = (
    "states without the joint",
    "states without the velocity that the law needs",
    "states not finite",
    "states out of order",
)


class Inputs:
    """Turns states into readings, with the latest reference from ``reference`` or ``~/reference``.

    Unusable messages are counted and ignored.
    """

    def __init__(self, config: ControllerConfig, refuse: Callable[[str, str], None]) -> None:
        """``refuse(what, why)`` is called for each message that is not used."""
        self._config = config
        self._refuse = refuse
        self._places = JointPlaces(config.joint, config.hip)
        self._read_state = WireReader()
        self._read_reference = WireReader()
        self._reference: float | None = None  # the latest from a topic

    def follow(self, node: Node, on_reading: Callable[[Reading], None]) -> None:
        """Subscribe to states and references on behalf of a node."""

        def on_state(data: bytes) -> None:
            reading = self.reading(data)
            if reading is not None:
                on_reading(reading)

        profile = qos.control(lockstep=self._config.lockstep)
        AdaptiveSubscription(node, topics.JOINT_STATES, on_state, profile)
        for topic in (topics.REFERENCE, OWN_REFERENCE):
            AdaptiveSubscription(node, topic, self._on_reference, qos.control(1))

    def reconfigure(self, config: ControllerConfig) -> None:
        """Take a changed configuration. A profile other than ``topic`` forgets the reference received."""
        self._config = config
        if config.reference_profile != "topic":
            self._reference = None

    def reading(self, data: bytes) -> Reading | None:
        """Return a state as the law reads it, None if something that the law needs is missing."""
        message = self._read_state(data)
        places = self._places(message.name)
        if places is None or places.last >= len(message.position):
            self._refuse(NO_JOINT, self._lacks(message))
            return None
        needed = self._config.uses_rate
        velocity = 0.0
        if places.last < len(message.velocity):
            velocity = message.velocity[places.joint]
            if not (needed or isfinite(velocity)):
                velocity = 0.0  # a broadcaster's NaN for what its hardware does not measure
        elif needed:
            self._refuse(
                NO_VELOCITY,
                f"{len(message.velocity)} values of velocity: one for each name is needed, in rad/s, or a "
                "derivative_mode other than rate",
            )
            return None
        position = message.position[places.joint]
        hip = hip_seen(places.hip, message.position, message.velocity)
        if not (isfinite(position) and isfinite(velocity) and all(map(isfinite, hip))):
            values = ", ".join(f"{value:g}" for value in (position, velocity, *hip))
            self._refuse(NOT_FINITE, f"position and velocity are {values}")
            return None
        effort = message.effort[places.joint] if places.joint < len(message.effort) else 0.0
        return Reading(
            message.stamp_ns,
            position,
            velocity,
            hip,
            effort if isfinite(effort) else 0.0,
            self._reference is not None,
            self._reference or 0.0,
        )

    def _on_reference(self, data: bytes) -> None:
        if self._config.reference_profile != "topic":
            self._refuse(
                "references ignored (reference.profile is not 'topic')",
                f"it is {self._config.reference_profile!r}: set it to 'topic' to follow them",
            )
            return
        message = self._read_reference(data)
        try:
            if has_doubled(message.name):
                raise ValueError
            value = message.position[message.name.index(self._config.joint)]
        except (ValueError, IndexError):
            self._refuse("references without the joint", self._lacks(message))
            return
        if isfinite(value):
            self._reference = value
        else:
            self._refuse("references not finite", f"the position is {value}, rad")

    def _lacks(self, message: JointSample) -> str:
        needed = [name for name in (self._config.joint, self._config.hip) if name is not None]
        return (
            f"their names are {quoted_names(message.name)}, with {len(message.position)} values of position: "
            f"{' and '.join(map(repr, needed))} must be there, and no name twice"
        )


class ControllerNode(TrunkNode[ControllerConfig]):
    """Answers each state that is due with a command carrying the state's stamp."""

    def __init__(self, law: Law) -> None:
        super().__init__(law.name, law.config)
        self._controller = Controller(self.config)
        self._names = law.record_names
        self._scheduled = bool(self.config.active_times)
        self._forget()

    def _forget(self) -> None:
        self.run_stamp_ns = -1
        self._controller.forget()
        self._controller.deactivate()
        self._inputs = Inputs(self.config, self.refuse)
        self._commensurate_known = False
        self._updates = self._skipped = 0
        self._diagnosed = (time.monotonic(), 0)
        self._looked_at_ns = -1

    def set_up(self) -> None:
        """Open the topics: states are followed from now on, and answered once active."""
        self._forget()
        self._command = self.create_replayable(topics.EFFORT_COMMAND)
        self._terms = self.create_replayable("~/state")
        self._controller_state = self.create_publisher(
            JointState, topics.CONTROLLER_STATE, qos.live()
        )
        self._inputs.follow(self, self._on_reading)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._ready_timer = self.every(0.02, self._announce)

    def starts_active(self) -> bool:
        """Return True unless this controller's turns are scheduled."""
        return not self._scheduled

    def activate(self) -> None:
        """Answer states; if the plant is already moving, start from the torque that acts."""
        self._controller.activate()

    def deactivate(self) -> None:
        """Leave the plant to another controller, but keep following the states."""
        self._controller.deactivate()

    def reconfigure(self, config: ControllerConfig) -> None:
        """Apply changed parameters between two samples; the law keeps the command from jumping."""
        self._controller.reconfigure(config)
        self._inputs.reconfigure(config)

    def _announce(self) -> None:
        """Report ready once a turn is due and the simulator is matched in both directions."""
        if not (self.active or self._scheduled):
            return
        if discovery.matched(self, hears=topics.JOINT_STATES, answers=topics.EFFORT_COMMAND):
            self._ready_timer.cancel()
            self.event(Event.READY, answers=topics.EFFORT_COMMAND)

    def _on_reading(self, reading: Reading) -> None:
        stamp_ns = reading.stamp_ns
        if stamp_ns < self.run_stamp_ns:
            self.counters[OUT_OF_ORDER] += 1
        if self.config.lockstep and not self._commensurate(stamp_ns - self.run_stamp_ns):
            return
        if self.run_stamp_ns < 0 < stamp_ns:
            self._join(stamp_ns)
        output = self._controller.decide(reading)
        if output.restarted and (gap_ns := stamp_ns - self.run_stamp_ns) > 0:
            self.refuse(
                "gaps in the states, started afresh after them",
                f"no states for {seconds(gap_ns):g} s up to t = {seconds(stamp_ns):g} s, "
                f"more than gap.max_periods ({self.config.max_gap_periods}) periods",
            )
        if output.active != self.active:
            self._take_turn(output.active)
        self.run_stamp_ns = stamp_ns
        if not output.active:
            return
        if output.held:
            self.counters["updates held: the law gave no finite number"] += 1
        self._skipped += not (output.updated or output.held)
        if output.updated or self.config.lockstep:
            self._publish(stamp_ns, reading.position, output)

    def _join(self, stamp_ns: int) -> None:
        """Record that the controller joins a run that is already under way.

        Without this, its earlier events would look as if it had been there from the start.
        """
        self.run_stamp_ns = stamp_ns - 1
        if self.active:
            self.event(Event.ACTIVATED)

    def _take_turn(self, active: bool) -> None:
        """Make the node's lifecycle follow what the schedule decided since the last state."""
        if active:
            self.trigger_activate()
        else:
            self.trigger_deactivate()

    def _commensurate(self, step_ns: int) -> bool:
        """Refuse, at the second state, a plant whose rate is not a multiple of this controller's."""
        if self._commensurate_known or self.run_stamp_ns < 0 or step_ns <= 0:
            return True
        self._commensurate_known = True
        ratio = self.config.period_ns / step_ns
        if ratio > 0.999 and abs(ratio - round(ratio)) < 1e-3:
            return True
        self.fail(
            f"update_rate = {self.config.update_rate:g} Hz is not allowed in lock-step with a plant at "
            f"{1e9 / step_ns:g} Hz: choose an integer divisor of the plant's rate"
        )
        return False

    def _publish(self, stamp_ns: int, measurement: float, output: Output) -> None:
        command = JointSample(stamp_ns, (self.config.joint,), effort=(output.effort,))
        self._command.publish(sample_to_wire(command, self.source))
        self._updates += 1
        if output.updated:
            if output.terms.effort != output.terms.unsaturated:
                self.counters["commands limited"] += 1
            values = state_record(output, measurement)
            terms = JointSample(stamp_ns, self._names, position=values)
            record = sample_to_wire(terms, self.source)
            self._terms.publish(record)
            if self._controller_state.get_subscription_count():
                self._controller_state.publish(record)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.ending:
            response.message = ENDING
            return response
        self._controller.reset()
        self.event(Event.RESET)
        response.success = True
        response.message = "integral and past samples cleared"
        return response

    def waits_for(self) -> discovery.Wait:
        """Return the knowledge about the states if none has arrived for a second."""
        before_ns, self._looked_at_ns = self._looked_at_ns, self.run_stamp_ns
        if self.run_stamp_ns > before_ns:
            return discovery.Wait()
        topic = self.resolve_topic_name(topics.JOINT_STATES)
        last_ns = self.run_stamp_ns if self.run_stamp_ns >= 0 else None
        refused = {kind: n for kind in UNUSED_STATES if (n := self.counters[kind])}
        publishers = discovery.described_publishers(self, topic)
        return discovery.states(topic, publishers, last_ns, refused)

    def tear_down(self) -> None:
        """Log how many commands were sent."""
        self._say_commands()

    def close(self) -> None:
        """Log how many commands were sent, then end."""
        if self.configured:
            self._say_commands()
        super().close()

    def _say_commands(self) -> None:
        until = f", the last at t = {seconds(self.run_stamp_ns):g} s" if self._updates else ""
        counted = "".join(f", {kind} {count}" for kind, count in self.counters.items() if count)
        self.get_logger().info(f"ended: {self._updates} commands given{until}{counted}")

    def diagnostics(self) -> dict[str, object]:
        """Return the last state's time in s, the achieved update rate, and how many states got no update."""
        now = time.monotonic()
        before, updates = self._diagnosed
        self._diagnosed = (now, self._updates)
        return {
            "time": f"{seconds(max(self.run_stamp_ns, 0)):.3f}",
            "rate": f"{(self._updates - updates) / max(now - before, 1e-9):.1f}",
            "states skipped, no update due": self._skipped,
        }


def main(name: str) -> None:
    """Run the node of the law of this name."""
    # Loaded inside `run_nodes`, which reports an error of the law in one line.
    sys.exit(run_nodes({name: lambda: ControllerNode(law_named(name))}, name))
