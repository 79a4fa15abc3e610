"""A running graph for the page: what it publishes, read at the page's pace, and the page's requests.

The graph never waits for it: its subscriptions to the loop are best effort, and it does not answer any of
the loop's messages.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from trunk_control.rule_base import RuleBaseConfig
from trunk_msgs_util import topics
from trunk_msgs_util.node import middleware, qos
from trunk_msgs_util.node.conversions import WireReader, stamp_from_ros
from trunk_msgs_util.samples import JointSample

from .feed import (
    PLANT,
    PUSHES,
    Board,
    RefusedRequestError,
    Stream,
    StreamRows,
    columns_of,
    put_stream,
    row_of,
    with_rules,
)
from .graph import Graph
from .graph_requests_node import GraphRequests
from .protocol import Asked

_KEPT_S = 60.0  # for a page that is opened later
_FEWEST, _MOST = 2_000, 120_000  # rows
_AT_ONCE = 500  # messages of a topic taken in a turn
_QUEUE = 5_000  # messages that wait for a turn
_LOOK_S = 0.05


class GraphFeed:
    """The nodes of a namespace, empty or ``/name``, in a ROS context of its own."""

    def __init__(self, namespace: str, standby: Sequence[str] = ()) -> None:
        """``standby``: controllers that follow the run until it is their turn."""
        self.board = Board()
        self.streams: list[Stream] = []
        self._namespace, self._standby = namespace, standby
        self.graph = Graph(self.board)
        middleware.prepare()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        # This node is never spun: its messages are taken in turns, many at once.
        self._node = Node(
            f"live_view_{os.getpid()}",
            namespace=namespace or "/",
            context=self._context,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self.requests = GraphRequests(self.graph, self._context, namespace)
        self._latest_ns = -1
        self._streams_of: dict[str, tuple[Subscription, WireReader]] = {}
        self._rows_of(PLANT, topics.GROUND_TRUTH)
        self._rows_of(PUSHES, topics.OPERATOR_PUSH)
        self._told = [
            (self._follow(kind, topic, profile), take)
            for kind, topic, profile, take in (
                (ParameterEvent, topics.RUN_PARAMETERS, qos.run_information(), self._on_parameters),
                (DiagnosticArray, topics.RUN_EVENTS, qos.run_information(), self._on_event),
                (DiagnosticArray, "/diagnostics", qos.control(10), self._on_diagnostics),
            )
        ]

    def turn(self) -> None:
        """Take what has come."""
        for subscription, take in self._told:
            for message in _taken(subscription):
                take(message)
        for name in self.graph.controllers:
            if name not in self._streams_of:
                self._rows_of(name, topics.controller_state(name))
        for name, (subscription, read) in self._streams_of.items():
            for data in _taken(subscription):
                self._add(name, read(data))
        self.requests.turn(self._latest_ns)

    async def ask(self, client: str, asked: Asked) -> str:
        """Do what a client asks for; return the answer. Raises RefusedRequestError."""
        if asked.kind == "stop":
            raise RefusedRequestError(
                "this graph was not started from here: stop it where it was started"
            )
        return await self.requests.ask(client, asked)

    async def begin(self) -> None:
        """Configure the controllers on standby, each once it is there."""
        for name in self._standby:
            while name not in self.graph.nodes:
                await asyncio.sleep(_LOOK_S)
            while self.graph.nodes[name].state == "unconfigured":
                with suppress(RefusedRequestError):  # a busy machine: it is asked again
                    await self.requests.change(name, Transition.TRANSITION_CONFIGURE, "inactive")

    def close(self) -> None:
        """Leave the graph."""
        self.requests.close()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _follow(
        self, kind: Any, topic: str, profile: QoSProfile, raw: bool = False
    ) -> Subscription:
        return self._node.create_subscription(kind, topic, lambda _: None, profile, raw=raw)

    def _rows_of(self, name: str, topic: str) -> None:
        """Follow a topic of the loop."""
        profile = QoSProfile(
            depth=_QUEUE,
            reliability=ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.VOLATILE,
        )
        self._streams_of[name] = self._follow(JointState, topic, profile, raw=True), WireReader()

    def _add(self, name: str, sample: JointSample) -> None:
        row = row_of(name, sample)
        if row is None:
            return
        config = self.graph.node(name).config if name in self.graph.nodes else None
        stream = next((s for s in self.streams if s.name == name), None)
        if stream is None:
            columns = columns_of(name, sample.name, config)
            kept = int(min(max(self.graph.simulator.update_rate * _KEPT_S, _FEWEST), _MOST))
            put_stream(self.board, self.streams, name, StreamRows(columns, kept))
            stream = self.streams[-1]
        if isinstance(config, RuleBaseConfig):
            row = with_rules(row, sample.name, config)
        if len(row) == len(stream.rows.names):
            stream.rows.add(row)
            if name == PLANT:
                self._latest_ns = sample.stamp_ns

    # What the nodes report.

    def _relative(self, name: str) -> str:
        """Return a node's name without the namespace; empty for a node in another namespace."""
        inside, _, own = name.rpartition("/")
        return own if inside == self._namespace else ""

    def _on_parameters(self, message: ParameterEvent) -> None:
        if name := self._relative(message.node):
            said = (*message.new_parameters, *message.changed_parameters)
            values = {
                parameter.name: parameter_value_to_python(parameter.value) for parameter in said
            }
            listed = {n: _listed(v) for n, v in values.items()}
            if message.new_parameters:
                self.graph.parameters(name, listed)
            else:
                self.graph.change(name, stamp_from_ros(message.stamp), listed)
                self.graph.put_events()
            self.requests.meet(name)

    def _on_event(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if name := self._relative(status.name):
                values = {pair.key: pair.value for pair in status.values}
                stamp_ns = stamp_from_ros(message.header.stamp)
                self.graph.event(name, stamp_ns, status.message, values)
        self.graph.put_events()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            name = self._relative(status.name)
            if name in self.graph.nodes:
                values = {pair.key: pair.value for pair in status.values}
                self.graph.diagnosed(name, status.level[0], status.message, values)


def _taken(subscription: Subscription) -> list[Any]:
    """Return the messages that have arrived, up to a limit."""
    messages: list[Any] = []
    while len(messages) < _AT_ONCE:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            break
        messages.append(taken[0])
    return messages


def _listed(value: Any) -> Any:
    """Return an array of rclpy as a list."""
    return list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value
