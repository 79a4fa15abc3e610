"""A gateway that serves in the test's process, with a feed that the test fills."""

import asyncio
import json
from collections.abc import Awaitable, Callable

from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.httpserver import HTTPServer
from tornado.testing import bind_unused_port
from tornado.websocket import WebSocketClientConnection, websocket_connect

from trunk_views.live.access import Site, Tokens
from trunk_views.live.feed import NAME, Board, RefusedRequestError, StreamRows, put_stream
from trunk_views.live.server import Gateway, page_files

NO_LIMIT = {"connect_timeout": 0.0, "request_timeout": 0.0}  # tornado: 20 s


class Feed:
    """A stream to which the test adds, and requests that are noted."""

    def __init__(self):
        self.board = Board()
        self.streams = []
        self.asked, self.hold = [], None
        put_stream(self.board, self.streams, "plant", StreamRows(("t", "v"), 1000))

    async def begin(self):
        pass

    def turn(self):
        pass

    async def ask(self, client, asked):
        if asked.kind == "pause":
            raise RefusedRequestError("no: it does not stand still")
        if self.hold is not None:
            await self.hold.wait()
        self.asked.append((client, asked))
        return "done"

    def close(self):
        pass


class Served:
    """A gateway that serves in this process, and clients of it."""

    def __init__(self, stoppable=False, url="", feed=None):
        listening, self.port = bind_unused_port()
        self.feed, self.said = feed or Feed(), []
        self.tokens = Tokens.new()
        site = Site.at(url or f"http://127.0.0.1:{self.port}")
        self.gateway = Gateway(
            self.feed, self.tokens, site, page_files(), self.said.append, stoppable
        )
        self.server: HTTPServer = self.gateway.server()
        self.server.add_socket(listening)
        self._connected: list[WebSocketClientConnection] = []
        self.turns = asyncio.get_running_loop().create_task(self.gateway.serve())

    async def get(self, path, **headers):
        request = HTTPRequest(f"http://127.0.0.1:{self.port}{path}", headers=headers, **NO_LIMIT)
        return await AsyncHTTPClient().fetch(request, raise_error=False)

    async def connect(self, token=None, **headers) -> WebSocketClientConnection:
        request = HTTPRequest(f"ws://127.0.0.1:{self.port}/live", headers=headers, **NO_LIMIT)
        offered = [NAME] if token == "" else [NAME, token or self.tokens.control]
        self._connected.append(await websocket_connect(request, subprotocols=offered))
        return self._connected[-1]

    async def until(self, condition):
        while not (found := condition()):
            assert not self.turns.done(), self.turns.exception()
            await asyncio.sleep(0.005)
        return found

    async def close(self):
        for connection in self._connected:
            connection.close()
        self.turns.cancel()
        self.server.stop()
        self.gateway.clients.clear()
        await self.server.close_all_connections()


def serving(test: Callable[[Served], Awaitable[None]], **more: object) -> None:
    async def run():
        served = Served(**more)
        try:
            await test(served)
        finally:
            await served.close()

    asyncio.run(run())


async def words(connection, kind):
    """Return the next message of this kind."""
    while True:
        message = await connection.read_message()
        assert message is not None, "the connection was closed"
        if isinstance(message, str) and json.loads(message)["kind"] == kind:
            return json.loads(message)
