"""The ``simulator`` node: takes in answers, steps when its pacing says so, and publishes each state."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import LEVEL_OK, LEVEL_WARN, Event
from trunk_core.units import nanoseconds, seconds, step_count
from trunk_msgs_util.node import discovery, qos
from trunk_msgs_util.node.base import ENDING, TrunkNode
from trunk_msgs_util.node.conversions import (
    WireReader,
    sample_from_ros,
    sample_to_wire,
    stamp_to_ros,
)
from trunk_msgs_util.node.discovery import Wait
from trunk_msgs_util.node.endpoints import AdaptiveSubscription
from trunk_msgs_util.node.execution import main_for
from trunk_msgs_util.node.strangers import near_misses
from trunk_msgs_util.source import source_in

from .config import SimulatorConfig, simulator_class
from .inputs import (
    NOTHING,
    Applied,
    Command,
    DisturbanceFeed,
    Disturbed,
    Operator,
    RefusedError,
    disturbance_of,
    effort_of,
    inputs_frame,
    inputs_row,
    request_of,
    with_operator,
)
from .pacing import DOUBLED, make_pacing, tick_period
from .participants_node import Participants
from .simulation import DivergedError, Simulation

_STARTED_BY = {
    topics.EFFORT_COMMAND: "a controller (such as ros2 run trunk_control fuzzy_pid)",
    topics.DISTURBANCE: "the disturbance (ros2 run trunk_sim disturbance)",
    topics.REFERENCE: "the reference (ros2 run trunk_control reference)",
    "recorder": "the recorder (ros2 run trunk_msgs_util recorder)",
}
# Without a controller for so long, and then every so often, the simulator looks for what goes astray.
_LOOK_AFTER_S, _LOOK_EVERY_S = 10.0, 5.0


class PlantOutputs:
    """Publishes on behalf of the simulator."""

    def __init__(self, node: TrunkNode[SimulatorConfig], config: SimulatorConfig) -> None:
        self._node = node
        self._truth = node.create_replayable(topics.GROUND_TRUTH)
        self._measured = node.create_replayable(topics.JOINT_STATES)
        self._inputs = None  # in lock-step they follow from the messages
        if not config.lockstep:
            self._inputs = node.create_replayable(topics.PLANT_INPUTS, live=False)
        self._inputs_until_ns = -1
        self._clock = (
            node.create_publisher(Clock, "/clock", qos.clock()) if config.publish_clock else None
        )

    def clock(self, stamp_ns: int) -> None:
        """Publish the time before any message stamped with it: no node sees a state from the future."""
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp_to_ros(stamp_ns)))

    def truth(self, sample: JointSample) -> None:
        """Publish the true state."""
        self._truth.publish(sample_to_wire(sample, self._node.source))

    def measured(self, sample: JointSample) -> None:
        """Publish the state as it reaches the controllers."""
        self._measured.publish(sample_to_wire(sample, self._node.source))

    def inputs(self, stamp_ns: int, command: Command, disturbed: Disturbed) -> None:
        """Publish what acts in a state, once: a plant that diverges has already published it as the last."""
        if self._inputs is None or stamp_ns <= self._inputs_until_ns:
            return
        self._inputs_until_ns = stamp_ns
        frame = inputs_frame(self._node.source, command, disturbed)
        self._inputs.publish(sample_to_wire(inputs_row(stamp_ns, command, disturbed), frame))


class SimulatorNode(TrunkNode[SimulatorConfig]):
    """Owns the run: waits for the participants, begins, steps, holds and resets."""

    def __init__(self) -> None:
        super().__init__("simulator", simulator_class)
        self._read_command = WireReader()
        self._read_disturbance = WireReader()
        self._read_progress = WireReader()
        self._read_reference = WireReader()
        self._forget()

    def _forget(self) -> None:
        config = self.config
        self._simulation = Simulation(config)
        self._steps = step_count(config.duration, config.update_rate) if config.duration else None
        self._running = False
        self._started = time.monotonic()
        self._disturbances = DisturbanceFeed(config.period_ns)
        self._referred = False  # has a reference arrived?
        limits = config.operator_limits
        self._operator = None if limits is None else Operator(limits)
        self._diagnosed = (time.monotonic(), 0)
        self._pacing = make_pacing(self, config)
        self.unfinished = ""
        # Steps with a command in force; those at the end without.
        self._commanded = self._silent = 0
        self._missing: Sequence[str] = ()
        self._pause_asked = False
        self._looked_s = math.inf
        self._seen_instead = ""
        self._truth_published = False

    def set_up(self) -> None:
        """Put the plant into its initial state and open the topics."""
        self._forget()
        self.run_stamp_ns = -1
        self._create_topics(self.config)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self._start_timer = self.every(0.02, self._try_start)
        self._start_timer.cancel()

    def activate(self) -> None:
        """Wait for the participants and begin; or resume where the run was held."""
        if self._running:
            self._hold(self._pause_asked)
        else:
            self._start_timer.reset()
            self._looked_s = time.monotonic() + _LOOK_AFTER_S - _LOOK_EVERY_S

    def deactivate(self) -> None:
        """Hold the run, or the wait for it: the plant stands still."""
        self._start_timer.cancel()
        if self._running:
            self._hold(True)

    def tear_down(self) -> None:
        """Forget the run; the record says how far it got."""
        self.stopping()

    def _create_topics(self, config: SimulatorConfig) -> None:
        self._outputs = PlantOutputs(self, config)
        self._commands = AdaptiveSubscription(
            self,
            topics.EFFORT_COMMAND,
            self._on_command,
            qos.control(lockstep=config.lockstep),
        )
        disturbances = AdaptiveSubscription(self, topics.DISTURBANCE, self._on_disturbance)
        answers = {topics.EFFORT_COMMAND: self._commands, topics.DISTURBANCE: disturbances}
        if topics.REFERENCE in config.wait_for:
            answers[topics.REFERENCE] = AdaptiveSubscription(
                self, topics.REFERENCE, self._on_reference
            )
        self._participants = Participants(self, config, answers)
        if config.lockstep and "recorder" in config.wait_for:
            self.create_subscription(
                JointState,
                topics.RECORDER_PROGRESS,
                self._on_progress,
                qos.latest(),
                raw=True,
            )
        if self._operator is not None:
            self._pushes = self.create_replayable(topics.OPERATOR_PUSH)
            self.create_subscription(
                JointState, topics.OPERATOR_REQUEST, self._on_request, qos.control()
            )
        self._step_timer = self.every(tick_period(config), self._tick)
        self._step_timer.cancel()

    def reconfigure(self, config: SimulatorConfig) -> None:
        """Take changed constants; they act from the next step on."""
        self._simulation.reconfigure(config)
        self._pacing.set_timeout(config.command_timeout)
        self._pacing.set_speed(config.lockstep_speed, time.monotonic_ns())
        if self.configured:
            self._step_timer.timer_period_ns = nanoseconds(tick_period(config))

    # Start: hold state 0 until every participant is matched in both directions.

    def _try_start(self) -> None:
        if self.ending:
            return  # nothing would report how that run ended
        missing = self._participants.missing(time.monotonic())
        if not missing and self.may_be_second():
            return
        if not missing and not self._truth_published:
            self._outputs.clock(self._simulation.stamp_ns)
            self._outputs.truth(self._simulation.truth())
            self._truth_published = True
        # The first measurement carries its disturbance too, and follows its reference.
        ahead = {topics.DISTURBANCE: bool(self._disturbances), topics.REFERENCE: self._referred}
        missing = missing or [t for t in self.config.wait_for if not ahead.get(t, True)]
        self._missing = missing
        if missing:
            return
        if self._participants.unsettled(time.monotonic()):
            return
        self._start_timer.cancel()
        if self._only_one_controller():
            self._begin()

    def waits_for(self) -> Wait:
        """Return the participants that are missing, and how to start them."""
        started_by, idle = dict(_STARTED_BY), self._participants.idle()
        if idle:
            names = ", ".join(name.rsplit("/", 1)[-1] for name in idle)
            started_by[topics.EFFORT_COMMAND] = (
                f"a controller that acts (inactive: {', '.join(idle)}; activate one, or, for turns by "
                f"active.times, start the simulator with controllers:=[{names}])"
            )
        missing = ", ".join(started_by.get(name, name) for name in self._missing)
        if topics.EFFORT_COMMAND not in self._missing or self._running or idle:
            met = {topics.EFFORT_COMMAND} if idle else set()
            return Wait(missing, unmet=not met.issuperset(self._missing))
        now = time.monotonic()
        if now - self._looked_s >= _LOOK_EVERY_S:
            self._looked_s = now
            answers, states = map(
                self.resolve_topic_name, (topics.EFFORT_COMMAND, topics.JOINT_STATES)
            )
            misses = near_misses(self, answers, states, topics.JOINT_STATE_TYPE, self._own_names())
            self._seen_instead = "; ".join(misses) or "nothing like it"
        return Wait(missing, self._seen_instead, unmet=True)

    def _own_names(self) -> list[str]:
        """Return the nodes that publish events of a run: none of them is a controller that goes astray."""
        return sorted(discovery.publishers(self, topics.RUN_EVENTS))

    def _begin(self) -> None:
        """Publish the measured state 0 and step from here on; the true state 0 is already published."""
        self._running = True
        self._started = time.monotonic()
        self._participants.look_for_strangers()
        self.event(Event.STARTED, rate=self.config.update_rate)
        self._publish_measured()
        self._say_fall()
        self._step_timer.reset()
        if self._participants.strangers():
            self._pacing.narrow("recorder", (topics.STRANGERS_DEPTH - 1) * self.period_ns)
        self._pacing.begin(time.monotonic_ns())

    def _every_second(self) -> None:
        if self._running:
            self._participants.look_for_strangers()
        super()._every_second()

    def _only_one_controller(self) -> bool:
        rivals = self._participants.rivals()
        if not rivals:
            return True
        self.fail(
            f"{len(rivals)} nodes publish {self._commands.topic_name}: {', '.join(rivals)}; "
            "one controller at a time: stop the others"
        )
        return False

    @property
    def leads_a_run(self) -> bool:
        """True from the first state to the last."""
        return self._running

    # The loop, as `pacing.Loop` wants it.

    @property
    def stamp_ns(self) -> int:
        """Simulated time of the published state, ns."""
        return self._simulation.stamp_ns

    @property
    def period_ns(self) -> int:
        """The plant's period, ns."""
        return self.config.period_ns

    @property
    def at_end(self) -> bool:
        """True where the published state is the run's last."""
        return self._simulation.step_index == self._steps or self._simulation.ended_by_fall

    def advance(self, effort: float) -> None:
        """Step with this effort and publish the new state; a plant that diverges ends the run."""
        if self.exit_code is not None:
            return  # the same tick has more steps to make up, but the run is over
        stamp_ns, command = self.stamp_ns, self._pacing.command_in_use
        disturbed = self._disturbances.in_use
        total = with_operator(disturbed.disturbance, self._pushed())
        try:
            self._simulation.step(effort, total)
        except DivergedError as error:
            self.fail(str(error))
            return
        self._publish_measured()
        self._outputs.truth(self._simulation.truth())
        # The controller waits for the state, nobody for this.
        self._outputs.inputs(stamp_ns, command, disturbed)
        commanded = command.stamp_ns >= 0
        self._commanded += commanded
        self._silent = 0 if commanded else self._silent + 1
        self._say_fall()

    def _pushed(self) -> Applied:
        """Return the operator's push over the step from the current state; publish a new request."""
        if self._operator is None:
            return NOTHING
        request = self._operator.new_request()
        if request is not None:
            sample = JointSample(self.stamp_ns, self.config.joints, effort=request)
            self._pushes.publish(sample_to_wire(sample, self.source))
        return self._operator.applied(self.stamp_ns)

    def finish(self) -> None:
        """End the run: the last state is answered."""
        self._step_timer.cancel()
        self._publish_diagnostics()  # the counts of the whole run
        self._publish_last_inputs()
        fell = self._simulation.ended_by_fall
        reason = self.config.kind.words("the trunk has fallen")
        self._say_finished(Event.FINISHED, reason if fell else "finished")
        wall = time.monotonic() - self._started
        steps = self._simulation.step_index
        counts = "".join(f", {count} {kind}" for kind, count in self.counters.items() if count)
        self.get_logger().info(f"finished: {steps} steps in {wall:.6f} s of wall time{counts}")
        self.exit_code = 0

    def fail(self, reason: str, **values: object) -> None:
        """End the run with an error; the record says how many states there are."""
        if self.configured:
            self._step_timer.cancel()
        if self._running:
            self._publish_last_inputs()
        self._say_counts()
        super().fail(reason, states=self._simulation.step_index + 1, **values)

    def count(self, kind: str, number: int = 1) -> None:
        """Count something for diagnostics; doubled answers may mean a second controller."""
        self.counters[kind] += number
        if kind in DOUBLED and self._running and self.exit_code is None:
            self._only_one_controller()

    def participant(self, topic: str) -> str:
        """Return who answers on a topic, in words for a message."""
        return self._participants.describe(topic)

    def _tick(self) -> None:
        if self.exit_code is None:
            self._pacing.tick(time.monotonic_ns())

    def _publish_measured(self) -> None:
        simulation = self._simulation
        self.run_stamp_ns = now = simulation.stamp_ns
        config = self.config
        timeout_ns = None if config.lockstep else nanoseconds(config.command_timeout)
        if self._disturbances.advance(now, timeout_ns):
            self.count("steps without a fresh disturbance")
        self._outputs.clock(now)
        self._outputs.measured(simulation.measure(self._disturbances.disturbance))

    def _publish_last_inputs(self) -> None:
        """Publish what acts in the last state, too: no step follows that would do so."""
        self._outputs.inputs(self.stamp_ns, self._pacing.command_in_use, self._disturbances.in_use)

    def _say_fall(self) -> None:
        if self._simulation.falls_now:
            angle = self._simulation.state.theta
            self.event(Event.FELL, LEVEL_WARN, angle=angle, limit=self.config.fall_angle)
            self.get_logger().warning(
                f"{self.config.kind.words('the trunk')} fell at t = {seconds(self.stamp_ns):g} s: "
                f"angle {angle:.3g} rad"
            )

    def _say_counts(self) -> None:
        if counts := self._simulation.link_counts():
            self.event(Event.PASSED_ON, LEVEL_OK, **counts)

    def _say_finished(self, message: Event, reason: str) -> None:
        self._say_counts()
        counts = {"states": self._simulation.step_index + 1}
        if not self.config.lockstep:
            counts |= {"commanded": self._commanded, "silent": self._silent}
        self.event(message, LEVEL_OK, reason=reason, **counts)

    def stopping(self) -> None:
        """Close the record: an endless run counts as finished when stopped, any other does not."""
        if not self._running:
            if self._steps is not None:
                self._say_unfinished("stopped before the run began")
            return
        self._running = False
        self._pacing.paused = True  # a recorder in this process may still take in what is in flight
        self._publish_last_inputs()
        if self._steps is None:
            self._say_finished(Event.FINISHED, "stopped on request")
        else:
            reason = f"stopped at t = {seconds(self.stamp_ns):g} s, before its end"
            self._say_finished(Event.STOPPED, reason)
            self._say_unfinished(reason)

    def _say_unfinished(self, reason: str) -> None:
        self.unfinished = reason
        self.get_logger().warning(f"{reason}: duration is {self.config.duration:g} s")

    # Incoming messages.

    def _sender(self, frame_id: str) -> str:
        """Return the source of an answer; one whose sender copied the state's whole header has none."""
        source = source_in(frame_id)
        return "" if source == self.source else source

    def _on_command(self, data: bytes) -> None:
        command = self._read_command(data)
        try:
            effort = effort_of(command, self.config.joints[1])
        except RefusedError as refused:
            self.refuse(str(refused), refused.why)
            return
        if self._running and self.exit_code is None:
            source = self._sender(self._read_command.frame_id)
            self._pacing.command(command.stamp_ns, effort, time.monotonic_ns(), source)

    def _on_disturbance(self, data: bytes) -> None:
        sample = self._read_disturbance(data)
        try:
            disturbance = disturbance_of(sample, self.config.joints)
            source = self._sender(self._read_disturbance.frame_id)
            self._disturbances.take(sample.stamp_ns, disturbance, self.stamp_ns, source)
        except RefusedError as refused:
            self.refuse(str(refused), refused.why)
        else:
            self._answered(topics.DISTURBANCE, sample.stamp_ns)

    def _on_reference(self, data: bytes) -> None:
        self._referred = True
        self._answered(topics.REFERENCE, self._read_reference(data).stamp_ns)

    def _on_request(self, message: JointState) -> None:
        if not (self._running and self._operator is not None and self.exit_code is None):
            return
        name, sample = message.header.frame_id, sample_from_ros(message)
        try:
            request = request_of(sample, self.config.joints)
            # Without a stamp, as from `ros2 topic pub`, it is for the latest state.
            self._operator.take(name, sample.stamp_ns or self.stamp_ns, request, self.stamp_ns)
        except RefusedError as refused:
            self.refuse(str(refused), refused.why)

    def _on_progress(self, data: bytes) -> None:
        stamp_ns = self._read_progress(data).stamp_ns
        if stamp_ns <= self.stamp_ns:  # else it is about an earlier run
            self._answered("recorder", stamp_ns)

    def _answered(self, topic: str, stamp_ns: int) -> None:
        if self.exit_code is None:
            self._pacing.answered(topic, stamp_ns, time.monotonic_ns())

    # Services.

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.ending:
            response.message = ENDING
            return response
        self._simulation.reset()
        self.event(Event.RESET)
        response.success = True
        response.message = "the plant is in its initial state " + (
            f"at t = {seconds(self.run_stamp_ns):g} s"
            if self.run_stamp_ns >= 0
            else "before the first state"
        )
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = self._running and self.active and not self.ending
        if response.success:
            self._pause_asked = request.data
            self._hold(request.data)
        if self.ending:
            response.message = ENDING
        else:
            response.message = self._state() if self.active else "inactive: activate the simulator"
        return response

    def _hold(self, hold: bool) -> None:
        if hold != self._pacing.paused:
            self.event(Event.PAUSED if hold else Event.RESUMED)
            if hold:
                self._pacing.paused = True
            else:
                self._pacing.begin(time.monotonic_ns())

    def _state(self) -> str:
        if not self._running:
            return "waiting for participants"
        return "paused" if self._pacing.paused else "running"

    def diagnostics(self) -> dict[str, object]:
        """Return progress, the achieved rate and the worst lateness since the last call."""
        now, step = time.monotonic(), self._simulation.step_index
        before, step_before = self._diagnosed
        self._diagnosed = (now, step)
        worst, self._pacing.worst_late_ns = self._pacing.worst_late_ns, 0
        return {
            "time": f"{seconds(self._simulation.stamp_ns):.3f}",
            "step": step,
            "rate": f"{(step - step_before) / max(now - before, 1e-9):.1f}",
            "worst lateness": f"{seconds(max(worst, 0)):.6f}",
            "state": self._state(),
        }


main = main_for(SimulatorNode, "simulator")
