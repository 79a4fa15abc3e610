"""When messages were written, according to the middleware that wrote them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from trunk_msgs_util.node import middleware, qos
from trunk_msgs_util.node.conversions import WireReader

# Messages may queue this long: waking for each would take processor time from the observed processes.
_GATHER_S = 0.05


class Observer:
    """Notes each message's stamp and the instant of its writing; a context manager with its own context.

    The instant is DDS's source timestamp, in ns of the system clock, which the writer's process sets
    when it writes: how late the observer itself is does not matter.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self.written_ns: dict[str, dict[int, int]] = {topic: {} for topic in topics}
        self._readers = {topic: WireReader() for topic in topics}
        middleware.prepare()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("observer", context=self._context, start_parameter_services=False)
        self._subscriptions = {
            topic: self._node.create_subscription(
                JointState, topic, lambda _: None, qos.control(qos.EVIDENCE_DEPTH), raw=True
            )
            for topic in topics
        }

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def take(self) -> None:
        """Take the messages that have arrived."""
        for topic, subscription in self._subscriptions.items():
            written_ns, read = self.written_ns[topic], self._readers[topic]
            while (taken := subscription.handle.take_message(JointState, True)) is not None:
                data, about = taken
                written_ns[read(data).stamp_ns] = about["source_timestamp"]

    def watch(self, seconds: float, check: Callable[[], None]) -> None:
        """Take the messages that arrive in the next ``seconds``; ``check`` is called now and then."""
        self.take()
        for written_ns in self.written_ns.values():
            written_ns.clear()
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            time.sleep(min(left, _GATHER_S))
            self.take()
            check()
