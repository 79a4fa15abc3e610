"""A running graph for the page: what it publishes, read at the page's pace, and the page's requests.

The graph never waits for it: its subscriptions to the loop are best effort, and it does not answer any of
the loop's messages.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import inf
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from trunk_control.rule_base import RuleBaseConfig
from trunk_core import topics
from trunk_core.deadline import Deadline
from trunk_core.samples import JointSample
from trunk_msgs_util.node import middleware, qos
from trunk_msgs_util.node.conversions import WireReader, sample_to_ros, stamp_from_ros
from trunk_runs.live_parameters import as_present

from .feed import (
    PLANT,
    PUSHES,
    Asked,
    Board,
    RefusedRequestError,
    Stream,
    StreamRows,
    columns_of,
    put_stream,
    row_of,
    with_rules,
)
from .graph_state import Graph

_KEPT_S = 60.0  # for a page that is opened later
_FEWEST, _MOST = 2_000, 120_000  # rows
_AT_ONCE = 500  # messages of a topic taken in a turn
_QUEUE = 5_000  # messages that wait for a turn
_LOOK_S = 0.05
_ANSWER_LOOK_S = 0.005
_INFINITE = ("inf", "+inf", "-inf")
_ANSWER_S = 10.0
_ANSWERS = 20  # taken in a turn
# A response that is sent before the server has matched the client is lost; these may be asked again.
_AGAIN_S = {SetParametersAtomically: 1.0, ChangeState: inf, Trigger: inf, SetBool: 1.0}


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
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
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


class GraphRequests:
    """Clients of the nodes' services, and publishers of what an operator does."""

    def __init__(self, graph: Graph, context: rclpy.Context, namespace: str) -> None:
        self._graph = graph
        self._node = Node(
            f"live_hand_{os.getpid()}",
            namespace=namespace or "/",
            context=context,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._clients: dict[tuple[type, str], Client] = {}
        self._pushes = self._node.create_publisher(JointState, topics.OPERATOR_REQUEST, qos.live())
        self._references = self._node.create_publisher(JointState, topics.REFERENCE, qos.live())
        self._latest_ns = -1
        self._asking = 0  # services that have not answered yet
        self._swaps = asyncio.Lock()
        self._referring = False

    def turn(self, latest_ns: int) -> None:
        """Take the services' answers; ``latest_ns``: the stamp of the last state that was seen."""
        self._latest_ns = latest_ns
        for _ in range(min(self._asking, _ANSWERS)):
            self._executor.spin_once(timeout_sec=0)

    def meet(self, name: str) -> None:
        """Make a node's clients in advance: the middleware needs a while to match them."""
        kinds = {SetParametersAtomically: "set_parameters_atomically", ChangeState: "change_state"}
        if name in (*self._graph.controllers, "simulator"):
            kinds[Trigger] = "reset"
        if name == "simulator":
            kinds[SetBool] = "pause"
        for kind, service in kinds.items():
            if (kind, name) not in self._clients:
                self._clients[kind, name] = self._node.create_client(kind, f"{name}/{service}")

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()

    async def ask(self, client: str, asked: Asked) -> str:
        """Do what a client asks for; return the answer. Raises RefusedRequestError."""
        values = asked.values
        if asked.kind == "push":
            self._push(client, values["force"], values["torque"])
        elif asked.kind == "reference":
            await self._refer(values["angle"])
        elif asked.kind == "set":
            return await self.set(values["node"], values["values"])
        elif asked.kind == "swap":
            async with self._swaps:
                return await self._swap(values["to"])
        elif asked.kind == "reset":
            return await self._reset()
        elif asked.kind == "pause":
            return await self._pause(values["on"])
        return ""

    # What an operator does.

    def _push(self, client: str, force: float, torque: float) -> None:
        # Unstamped: for the latest state. What a slow page saw is older, but its hand is there.
        sample = JointSample(0, self._graph.simulator.joints, effort=(force, torque))
        message = sample_to_ros(sample)
        message.header.frame_id = client
        self._pushes.publish(message)

    async def _refer(self, angle: float) -> None:
        if self._referring:  # the next one comes with the next picture
            return
        others = [
            name
            for name in self._graph.controllers
            if self._graph.nodes[name].values.get("reference.profile") != "topic"
        ]
        if others:  # until a message arrives, the value applies
            self._referring = True
            try:
                for name in others:
                    await self.set(name, {"reference.profile": "topic", "reference.value": angle})
            finally:
                self._referring = False
        joint = self._graph.simulator.joints[1]
        self._references.publish(
            sample_to_ros(JointSample(max(self._latest_ns, 0), (joint,), (angle,)))
        )

    # Services.

    async def set(self, name: str, values: dict[str, Any]) -> str:
        """Set all of these parameters or none. Raises RefusedRequestError with the node's reason."""
        node = self._graph.nodes.get(name)
        if node is None:
            raise RefusedRequestError(f"no node {name!r} is known here")
        parameters = []
        for parameter, value in values.items():
            try:
                present = node.values.get(parameter)
                if isinstance(present, float) and value in _INFINITE:
                    value = float(value)  # JSON has no such number
                parameters.append(
                    Parameter(parameter, value=as_present(value, present)).to_parameter_msg()
                )
            except (TypeError, ValueError, AssertionError, OverflowError):
                raise RefusedRequestError(
                    f"{name}: parameter {parameter!r}: {value!r} cannot be the value of a ROS 2 parameter"
                ) from None
        request = SetParametersAtomically.Request(parameters=parameters)
        response = await self.call(SetParametersAtomically, name, request)
        if not response.result.successful:
            raise RefusedRequestError(f"{name}: {response.result.reason}")
        return f"{name}: {', '.join(values)} set"

    async def _swap(self, to: str) -> str:
        nodes = self._graph.nodes
        if to not in self._graph.controllers:
            raise RefusedRequestError(f"no controller {to!r} is known here")
        acting = [n for n in self._graph.controllers if nodes[n].state == "active" and n != to]
        if nodes[to].state == "active" and not acting:
            return f"{to} already acts"
        scheduled = [n for n in (to, *acting) if nodes[n].values.get("active.times")]
        if scheduled:
            raise RefusedRequestError(
                f"{scheduled[0]}: active.times says when it acts: it takes no other turns"
            )
        if nodes[to].state == "unconfigured":
            await self.change(to, Transition.TRANSITION_CONFIGURE, "inactive")
        # In lock-step the run waits for an answer to each state: none may be due without a controller.
        hold = self._graph.simulator.lockstep and self._graph.started and not self._graph.paused
        if hold:
            await self._pause(True)
        try:
            for name in acting:
                await self.change(name, Transition.TRANSITION_DEACTIVATE, "inactive")
            await self.change(to, Transition.TRANSITION_ACTIVATE, "active")
        except RefusedRequestError:
            if nodes[to].state != "active":  # better the previous one than none
                for name in acting:
                    await self.change(name, Transition.TRANSITION_ACTIVATE, "active")
            raise
        finally:
            if hold:
                await self._pause(False)
        return f"{to} acts"

    async def change(self, name: str, transition: int, state: str) -> None:
        """Change a node's state; done when the node itself has reported it."""
        await self.call(
            ChangeState,
            name,
            ChangeState.Request(transition=Transition(id=transition)),
            lambda: self._graph.nodes[name].state == state,
        )

    async def _reset(self) -> str:
        names = [n for n in self._graph.controllers if self._graph.nodes[n].state != "unconfigured"]
        for name in ("simulator", *names):
            await self.call(Trigger, name, Trigger.Request())
        return "plant and controllers are reset"

    async def _pause(self, on: bool) -> str:
        response = await self.call(SetBool, "simulator", SetBool.Request(data=on))
        if not response.success:
            raise RefusedRequestError(f"simulator: {response.message}")
        return str(response.message)

    async def call(
        self, kind: Any, name: str, request: Any, happened: Callable[[], bool] | None = None
    ) -> Any:
        """Return a service's response; None once ``happened`` returns True."""
        self.meet(name)
        client = self._clients.get((kind, name))
        if client is None:
            raise RefusedRequestError(f"{name} has no such service")
        futures: list[Any] = []
        ask_s, deadline = -inf, Deadline(_ANSWER_S)
        self._asking += 1
        try:
            while True:
                now = time.monotonic()
                if now > ask_s and client.service_is_ready():
                    ask_s = now + _AGAIN_S[kind]
                    futures.append(client.call_async(request))
                if happened is not None and happened():
                    return None
                done = [future.result() for future in futures if future.done()]
                if done and happened is None:
                    return done[0]
                if done and not done[0].success:
                    raise RefusedRequestError(
                        f"{name}: refused; it is {self._graph.nodes[name].state}"
                    )
                if deadline.passed:
                    raise RefusedRequestError(
                        f"{name} did not answer within {deadline.limit_s:g} s"
                    )
                await asyncio.sleep(_ANSWER_LOOK_S)
        finally:
            self._asking -= 1
            for future in futures:
                client.remove_pending_request(future)
