"""Plays states at a running controller's node, over the real graph, and takes down what it answers."""

from __future__ import annotations

import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from trunk_msgs_util import topics
from trunk_msgs_util.node import middleware, qos
from trunk_msgs_util.node.adaptive import AdaptiveSubscription
from trunk_msgs_util.node.conversions import WireReader, sample_to_wire
from trunk_msgs_util.node.strangers import Sender, Senders, misfits, near_misses
from trunk_msgs_util.samples import JointSample

from ..errors import RunError
from .node_judge import (
    SILENCE,
    SILENT_S,
    Exchange,
    Played,
    TimedCommand,
    Transcript,
    states_to_play,
)

_ANSWER_S = 0.25  # for an answer; a few states that have none make the wait shorter
_HURRY_S = 0.02
_LATE_S = 2.0  # for the last ones
_PATIENT_STATES = 5
_MATCHED_S = 0.5  # after discovery, until both sides know one another
_NAMED_S = 3.5
_RESET_S = 2.0


class Player:
    """A node in the simulator's place; a context manager that owns its ROS context."""

    def __init__(self, namespace: str, joints: tuple[str, str]) -> None:
        middleware.prepare()
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(
            "simulator",
            namespace=namespace or "/",
            context=self._context,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._joints = joints
        self._states = self._node.create_publisher(JointState, topics.JOINT_STATES, qos.live())
        self._references = self._node.create_publisher(JointState, topics.REFERENCE, qos.live())
        self._commands = AdaptiveSubscription(self._node, topics.EFFORT_COMMAND, self._on_command)
        self._topic = self._commands.topic_name
        self._senders = Senders(self._node, self._topic, topics.JOINT_STATE_TYPE)
        self._read = WireReader()
        self._published_s = 0.0
        self._answers: list[TimedCommand] = []  # to the state that was published last
        self._stamp_ns = -1  # of that state
        self._earlier: set[int] = set()  # the stamps of those before it, since the last reset
        self._late: list[TimedCommand] = []  # to one of those
        self._unanswered = 0

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def meet(self, wait_s: float) -> Sender:
        """Wait for one node that publishes commands and hears states, and return who it is.

        Raises RunError if there is none in time, saying what is there instead, or if there are several.
        """
        end = time.monotonic() + wait_s
        matched_since: float | None = None
        while True:
            self._executor.spin_once(timeout_sec=0.05)
            now = time.monotonic()
            met = self._commands.get_publisher_count() and self._states.get_subscription_count()
            matched_since = (matched_since or now) if met else None
            senders = self._senders.look()
            named = not any(s.name.endswith(topics.UNKNOWN_NODE) for s in senders)
            if matched_since is not None and now - matched_since >= _MATCHED_S and named:
                if len(senders) > 1:
                    names = ", ".join(sender.label for sender in senders)
                    raise RunError(
                        f"{len(senders)} nodes publish {self._topic}: {names}: stop all but one"
                    )
                return senders[0]
            if now > end and not (met and now < end + _NAMED_S):
                raise RunError(self._nobody(wait_s))

    def sees(self, topic: str) -> bool:
        """Return True if somebody is known to publish on a topic, by its absolute name."""
        return self._node.count_publishers(topic) > 0

    def _nobody(self, wait_s: float) -> str:
        hears = self._node.resolve_topic_name(topics.JOINT_STATES)
        if self._commands.get_publisher_count():
            odd = misfits(self._node, self._topic, hears, topics.JOINT_STATE_TYPE)
            why = "; ".join(odd) or f"nobody hears {hears}: subscribe to it"
            return f"a node publishes {self._topic}, but {why}"
        misses = near_misses(self._node, self._topic, hears, topics.JOINT_STATE_TYPE, [])
        seen = f": {'; '.join(misses)}" if misses else ""
        return f"nobody publishes {self._topic} within {wait_s:g} s{seen}: start your node first"

    def play(self, rate: float, sender: Sender, limit: float | None) -> Transcript:
        """Play all states, one after the other's answer, and return what was exchanged."""
        exchanges: list[Exchange] = []
        again = False
        for played in states_to_play(rate):
            if played.again and not again:
                again = True
                self._await_late(exchanges)
                self._reset(sender)
            exchanges.append(self._exchange(played))
            self._attribute(exchanges)
        self._await_late(exchanges)
        return Transcript(self._joints[1], exchanges, limit)

    def _exchange(self, played: Played) -> Exchange:
        reference = JointSample(played.stamp_ns, self._joints[1:], (played.reference,))
        state = JointSample(
            played.stamp_ns, self._joints, played.position, played.velocity, (0.0, 0.0)
        )
        self._answers, self._late = [], []
        # A stamp of 0 is also none at all: it belongs to no earlier state.
        self._earlier = {s for s in (*self._earlier, self._stamp_ns) if 0 < s < played.stamp_ns}
        self._stamp_ns = played.stamp_ns
        self._references.publish(sample_to_wire(reference))
        self._published_s = time.perf_counter()
        self._states.publish(sample_to_wire(state))
        if played.phase == SILENCE:
            self._spin(SILENT_S, until_answered=False)
        else:
            patient = self._unanswered < _PATIENT_STATES
            wait_s = _ANSWER_S if patient else _HURRY_S
            self._spin(_LATE_S if played.stamp_ns == 0 else wait_s, until_answered=True)
        self._unanswered = 0 if self._answers else self._unanswered + 1
        return Exchange(played, tuple(self._answers))

    def _attribute(self, exchanges: list[Exchange]) -> None:
        """Give late answers to the states whose stamps they carry: this machine may be busy."""
        for answer in self._late:
            for place in reversed(range(len(exchanges))):
                played, answers = exchanges[place]
                if played.stamp_ns == answer.command.stamp_ns:
                    exchanges[place] = Exchange(played, (*answers, answer))
                    break
        self._late.clear()

    def _await_late(self, exchanges: list[Exchange]) -> None:
        """Wait, for a bounded time, for the answers that are still missing."""
        end = time.monotonic() + _LATE_S
        while time.monotonic() < end and not all(e.answers for e in exchanges[-_PATIENT_STATES:]):
            self._executor.spin_once(timeout_sec=0.01)
            self._attribute(exchanges)

    def _spin(self, for_s: float, until_answered: bool) -> None:
        end = time.monotonic() + for_s
        while time.monotonic() < end and not (until_answered and self._answers):
            self._executor.spin_once(timeout_sec=0.01)

    def _reset(self, sender: Sender) -> None:
        """Ask the node to start anew, where it offers that; time going back says the same."""
        if not sender.name:
            return
        client = self._node.create_client(Trigger, f"{sender.name}/reset")
        if client.wait_for_service(timeout_sec=0.2):
            future = client.call_async(Trigger.Request())
            self._executor.spin_until_future_complete(future, timeout_sec=_RESET_S)
        self._node.destroy_client(client)

    def _on_command(self, data: bytes) -> None:
        after_s = time.perf_counter() - self._published_s
        command = self._read(data)
        late = command.stamp_ns in self._earlier
        (self._late if late else self._answers).append(TimedCommand(after_s, command, late))
