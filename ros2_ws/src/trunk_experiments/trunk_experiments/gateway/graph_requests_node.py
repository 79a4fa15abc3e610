"""What a page asks of a running graph: pushes, references, parameters, swaps, resets, pauses."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable
from math import inf
from typing import Any

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from trunk_msgs_util import topics
from trunk_msgs_util.cpu_deadline import CpuDeadline
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import sample_to_ros
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.source import local_pid

from ..live.parameters import as_present
from .feed import RefusedRequestError
from .graph import Graph
from .protocol import Asked

_LOOK_S = 0.005
_INFINITE = ("inf", "+inf", "-inf")
_ANSWER_S = 10.0
_ANSWERS = 20  # taken in a turn
# A response that is sent before the server has matched the client is lost; these may be asked again.
_AGAIN_S = {SetParametersAtomically: 1.0, ChangeState: inf, Trigger: inf, SetBool: 1.0}


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
        ask_s, deadline = -inf, CpuDeadline(_ANSWER_S)
        there = local_pid(self._graph.nodes[name].process) if name in self._graph.nodes else None
        awaited = [os.getpid(), *([there] if there else [])]
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
                if deadline.spent(awaited):
                    raise RefusedRequestError(f"{name} did not answer within {_ANSWER_S:g} s")
                await asyncio.sleep(_LOOK_S)
        finally:
            self._asking -= 1
            for future in futures:
                client.remove_pending_request(future)
