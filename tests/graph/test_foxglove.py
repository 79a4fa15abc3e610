"""`trunk live --foxglove`, by the protocol that Foxglove and Lichtblick speak."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import struct
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

import pytest
from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from trunk_msgs_util.node.conversions import WireReader
from trunk_msgs_util.recording.schemas import definition
from trunk_msgs_util.topics import JOINT_STATE_TYPE

from .live_page import start_live
from .peer import Peer
from .processes import Children, until

pytest.importorskip("foxglove", reason="requirements/foxglove.txt")
pytestmark = pytest.mark.graph

_MESSAGE, _SERVICE_REQUEST, _SERVICE_ANSWER = 1, 2, 3


class Viewer:
    """What a viewer receives, and what it asks."""

    def __init__(self, connection: WebSocketClientConnection) -> None:
        self._connection = connection
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.parameters: dict[str, dict[str, Any]] = {}  # by what asked for them
        self._asked = 0
        self.messages: dict[int, list[bytes]] = {}
        self.answers: list[bytes] = []

    async def until(self, condition: Callable[[], Any]) -> Any:
        """Listen until the condition is truthy, and return it."""
        while not (found := condition()):
            message = await self._connection.read_message()
            assert message is not None, "the connection was closed"
            self._hear(message)
        return found

    async def say(self, op: str, **values: object) -> None:
        await self._connection.write_message(json.dumps({"op": op, **values}))

    async def answer(self, op: str, **values: object) -> dict[str, Any]:
        """Say something that is answered with parameters; return them."""
        self._asked += 1
        await self.say(op, **values, id=f"asked {self._asked}")
        await self.until(lambda: f"asked {self._asked}" in self.parameters)
        return self.parameters.pop(f"asked {self._asked}")

    async def subscribe(self, topics: Sequence[str]) -> None:
        wanted = [{"id": n, "channelId": self.channels[t]["id"]} for n, t in enumerate(topics)]
        await self.say("subscribe", subscriptions=wanted)

    async def call(self, name: str, request: bytes) -> bytes:
        """Call a service; return the answer's content."""
        service = await self.until(lambda: self.services.get(name))
        head = struct.pack("<BIII", _SERVICE_REQUEST, service["id"], 7, 3) + b"cdr"
        await self._connection.write_message(head + request, binary=True)
        await self.until(lambda: self.answers)
        return self.answers.pop()

    def _hear(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            if message[0] == _MESSAGE:
                (number,) = struct.unpack_from("<I", message, 1)
                self.messages.setdefault(number, []).append(message[13:])
            elif message[0] == _SERVICE_ANSWER:
                (length,) = struct.unpack_from("<I", message, 9)
                self.answers.append(message[13 + length :])
            return
        said = json.loads(message)
        if said["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in said["channels"]}
        elif said["op"] == "advertiseServices":
            self.services |= {service["name"]: service for service in said["services"]}
        elif said["op"] == "parameterValues":
            values = {one["name"]: one.get("value") for one in said["parameters"]}
            self.parameters[said.get("id", "")] = values


def viewing(port: str, test: Callable[[Viewer], Awaitable[None]]) -> None:
    async def run() -> None:
        connection = await websocket_connect(
            HTTPRequest(f"ws://127.0.0.1:{port}"), subprotocols=["foxglove.sdk.v1"]
        )
        await test(Viewer(connection))
        connection.close()

    asyncio.run(run())


def test_topics_parameters_and_services_are_there(children: Children, peer: Peer) -> None:
    child, *_ = start_live(children, "demo", "--foxglove", "0", "--output", "run")
    port = until(lambda: re.search(r"ws://127\.0\.0\.1:(\d+)", child.stdout), "the port")[1]
    peer.until_started(child)

    async def test(viewer: Viewer) -> None:
        topics = ("/ground_truth/joint_states", "/fuzzy_pid/state", "/run/events")
        await viewer.until(lambda: set(topics) <= set(viewer.channels))
        states = viewer.channels[topics[0]]
        assert (states["encoding"], states["schemaName"]) == ("cdr", JOINT_STATE_TYPE)
        assert states["schema"] == definition(JOINT_STATE_TYPE).decode()
        await viewer.subscribe(topics)
        await viewer.until(lambda: len(viewer.messages) == len(topics))  # past events, too
        assert WireReader()(viewer.messages[0][0]).name == ("hip", "trunk")
        assert "kp" in WireReader()(viewer.messages[1][0]).name

        # The answer has what is known at that time.
        d_min = "/fuzzy_pid.gains.d_min"
        while d_min not in await viewer.answer("getParameters", parameterNames=[]):
            pass
        change = [{"name": d_min, "value": 8.5}]
        while (await viewer.answer("setParameters", parameters=change)).get(d_min) != 8.5:
            pass
        # Refused: the answer has the value that is kept.
        wrong = [{"name": d_min, "value": 99.0}]
        assert await viewer.answer("setParameters", parameters=wrong) == {d_min: 8.5}

        cdr = b"\x00\x01\x00\x00"
        answer = await viewer.call("/simulator/pause", cdr + b"\x01")
        assert answer[4] == 1
        assert b"paused" in answer

    viewing(port, test)
    peer.until_event("simulator", "paused")
    child.send(signal.SIGINT)
    assert child.wait() == 0, child.stderr


def test_a_port_that_is_taken_is_named(children: Children) -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        child = children.trunk("live", "--attach", "/", "--no-browser", "--foxglove", str(port))
        assert child.wait() != 0
    assert f"--foxglove {port}" in child.stderr
    assert child.stderr.count("\n") == 1
