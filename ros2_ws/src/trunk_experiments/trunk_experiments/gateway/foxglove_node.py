"""A running graph for Foxglove and Lichtblick: topics, parameters and services, by foxglove-sdk.

A process of its own: ``foxglove_node NAMESPACE PORT``, until its standard input ends. As for the page, the
graph never waits for it.
"""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

import foxglove
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    MessageSchema,
    Parameter,
    ServerListener,
    Service,
    ServiceRequest,
    ServiceSchema,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from std_srvs.srv import SetBool, Trigger

from trunk_msgs_util import topics
from trunk_msgs_util.node import qos
from trunk_msgs_util.recording.schemas import definition

from .feed import RefusedRequestError
from .graph_feed_node import GraphFeed, taken
from .priority import give_way
from .process import LOOPBACK

_TURN_S = 1.0 / 60.0
_QUEUE = 2_000
_JOINTS = (
    *(topics.JOINT_STATES, topics.GROUND_TRUTH, topics.EFFORT_COMMAND, topics.DISTURBANCE),
    *(topics.REFERENCE, topics.OPERATOR_PUSH),
)
_TOPICS = {
    **dict.fromkeys(_JOINTS, topics.JOINT_STATE_TYPE),
    **topics.PICTURES,
    topics.RUN_EVENTS: topics.DIAGNOSTIC_ARRAY_TYPE,
    topics.RUN_PARAMETERS: topics.PARAMETER_EVENT_TYPE,
    "/diagnostics": topics.DIAGNOSTIC_ARRAY_TYPE,
}
_ANSWER = "bool success\nstring message\n"
_SERVICES: dict[str, tuple[Any, str, str]] = {  # name -> class, type, text of the request
    "reset": (Trigger, "std_srvs/srv/Trigger", ""),
    "pause": (SetBool, "std_srvs/srv/SetBool", "bool data\n"),
}


class _Passed(NamedTuple):
    """A topic that is passed on; ``latched``: its past messages, for late subscribers."""

    subscription: Subscription
    channel: foxglove.Channel
    latched: list[bytes] | None


class Bridge(ServerListener):
    """The graph of a namespace behind a Foxglove WebSocket server."""

    def __init__(self, namespace: str, port: int) -> None:
        """Serve on the loopback interface. Raises RuntimeError where the port is taken."""
        self._namespace = namespace
        self._feed = GraphFeed(namespace)
        self._loop = asyncio.get_running_loop()
        self._passed: dict[str, _Passed] = {}
        self._served: set[str] = set()
        self._told: dict[str, object] = {}
        self._server = foxglove.start_server(
            name=f"trunk {namespace}".strip(),
            host=LOOPBACK,
            port=port,
            capabilities=[Capability.Parameters, Capability.Services],
            supported_encodings=["cdr"],
            server_listener=self,
        )
        for topic, kind in _TOPICS.items():
            self._pass_on(topic, kind)

    async def serve(self) -> None:
        """Take turns forever."""
        while True:
            self._feed.turn()
            for name in self._feed.graph.controllers:
                self._pass_on(topics.controller_state(name), topics.JOINT_STATE_TYPE)
            for passed in self._passed.values():
                for data in taken(passed.subscription, True):
                    passed.channel.log(data, log_time=time.time_ns())
                    if passed.latched is not None:
                        passed.latched.append(data)
                        del passed.latched[: -topics.LATCHED_DEPTH]
            self._tell()
            await asyncio.sleep(_TURN_S)

    @property
    def port(self) -> int:
        """The port that is served."""
        return self._server.port

    def close(self) -> None:
        """Leave the graph, and stop serving."""
        self._server.stop()
        self._feed.close()

    def _pass_on(self, topic: str, kind: str) -> None:
        package, _, name = kind.split("/")
        if topic in self._passed or find_spec(package) is None:  # not every ROS 2 has tf2_msgs
            return
        latched = topic in topics.LATCHED
        profile = QoSProfile(
            depth=_QUEUE,
            reliability=ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.VOLATILE,
        )
        subscription = self._feed.follow(
            getattr(import_module(f"{package}.msg"), name),
            topic,
            qos.run_information() if latched else profile,
            raw=True,
        )
        schema = foxglove.Schema(name=kind, encoding="ros2msg", data=definition(kind))
        channel = foxglove.Channel(subscription.topic_name, schema=schema, message_encoding="cdr")
        self._passed[topic] = _Passed(subscription, channel, [] if latched else None)

    def _tell(self) -> None:
        """Offer the services of new nodes, and publish parameters that have changed."""
        for name in ("simulator", *self._feed.graph.controllers):
            if name in self._feed.graph.nodes and name not in self._served:
                self._served.add(name)
                kinds = ["reset", "pause"] if name == "simulator" else ["reset"]
                self._server.add_services([self._service(name, kind) for kind in kinds])
        now = self._values()
        changed = {name: value for name, value in now.items() if self._told.get(name) != value}
        self._told = now
        if changed:
            self._server.publish_parameter_values(_parameters(changed))

    def _values(self) -> dict[str, object]:
        return {
            f"{self._namespace}/{node.name}.{name}": value
            for node in self._feed.graph.nodes.values()
            for name, value in node.values.items()
        }

    def _service(self, node: str, kind: str) -> Service:
        cls, schema, text = _SERVICES[kind]

        def handle(request: ServiceRequest) -> bytes:
            asked = deserialize_message(request.payload, cls.Request) if text else cls.Request()
            return bytes(serialize_message(self._wait(self._feed.requests.call(cls, node, asked))))

        def words(direction: str, definition: str) -> MessageSchema:
            return MessageSchema(
                encoding="cdr",
                schema=foxglove.Schema(
                    name=f"{schema}_{direction}", encoding="ros2msg", data=definition.encode()
                ),
            )

        return Service(
            name=f"{self._namespace}/{node}/{kind}",
            schema=ServiceSchema(
                name=schema, request=words("Request", text), response=words("Response", _ANSWER)
            ),
            handler=handle,
        )

    def _wait(self, doing: Coroutine[Any, Any, Any]) -> Any:
        """Run a coroutine in the loop and return its result; called by the server's threads."""
        return asyncio.run_coroutine_threadsafe(doing, self._loop).result()

    # What the server calls, in its own threads.

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Send the past messages of a latched topic to a new subscriber."""

        def repeat() -> None:
            for passed in self._passed.values():
                if passed.latched is not None and passed.channel.id() == channel.id:
                    for data in passed.latched:
                        passed.channel.log(data, log_time=time.time_ns())

        self._loop.call_soon_threadsafe(repeat)

    def on_get_parameters(
        self, client: Client, param_names: list[str], request_id: str | None = None
    ) -> list[Parameter]:
        """Return parameters by ``NODE.NAME``; all of them if none is named."""
        values = self._told
        return _parameters({n: values[n] for n in param_names or values if n in values})

    def on_set_parameters(
        self, client: Client, parameters: list[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        """Set parameters, all of a node's or none; return their values afterwards."""
        asked: dict[str, dict[str, Any]] = {}
        for parameter in parameters:
            node, _, name = parameter.name.removeprefix(f"{self._namespace}/").partition(".")
            asked.setdefault(node, {})[name] = parameter.get_value()
        for node, values in asked.items():
            with suppress(RefusedRequestError):  # the answer shows that they are unchanged
                self._wait(self._feed.requests.set(node, values))
        return self.on_get_parameters(client, [p.name for p in parameters], request_id)


def _parameters(values: dict[str, Any]) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


async def _serve(namespace: str, port: int, say: Callable[[str], object]) -> None:
    try:
        bridge = Bridge(namespace, port)
    except RuntimeError as error:
        say(f"port {port}: {error}: give another with --foxglove PORT\n")
        return
    print(bridge.port, flush=True)
    give_way()
    serving = asyncio.create_task(bridge.serve())
    stdin = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(stdin), sys.stdin
    )
    ends = asyncio.create_task(stdin.read())
    await asyncio.wait([serving, ends], return_when=asyncio.FIRST_COMPLETED)
    bridge.close()
    if serving.done():
        serving.result()


def main() -> None:
    """Serve until standard input ends."""
    asyncio.run(_serve(sys.argv[1], int(sys.argv[2]), sys.stderr.write))


if __name__ == "__main__":
    main()
