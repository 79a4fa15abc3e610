"""The gateway's server against who wants to get past it: no token, other origins, floods, nonsense."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.httpserver import HTTPServer
from tornado.testing import bind_unused_port
from tornado.websocket import WebSocketClientConnection, websocket_connect

from trunk_experiments.gateway.access import MOST_CLIENTS, Hosts, Tokens
from trunk_experiments.gateway.board import Board
from trunk_experiments.gateway.feed import RefusedRequestError, put_stream
from trunk_experiments.gateway.page_files import PageFile, page_files
from trunk_experiments.gateway.protocol import LONGEST, NAME
from trunk_experiments.gateway.rows import Rows
from trunk_experiments.gateway.server import Gateway


class Feed:
    """A stream to which the test adds, and requests that are noted."""

    def __init__(self):
        self.board = Board()
        self.streams = []
        self.asked, self.hold = [], None
        put_stream(self.board, self.streams, "plant", Rows(("t", "v"), 1000))

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

    def __init__(self, stoppable=False):
        listening, self.port = bind_unused_port()
        self.feed, self.said = Feed(), []
        self.tokens = Tokens.new()
        hosts = Hosts(frozenset({"127.0.0.1", "localhost"}), self.port)
        self.gateway = Gateway(
            self.feed, self.tokens, hosts, page_files(), self.said.append, stoppable
        )
        self.server: HTTPServer = self.gateway.server()
        self.server.add_socket(listening)
        self._connected: list[WebSocketClientConnection] = []
        self.turns = asyncio.get_running_loop().create_task(self.gateway.serve())

    async def get(self, path, **headers):
        request = HTTPRequest(f"http://127.0.0.1:{self.port}{path}", headers=headers)
        return await AsyncHTTPClient().fetch(request, raise_error=False)

    async def connect(self, token=None, **headers) -> WebSocketClientConnection:
        request = HTTPRequest(f"ws://127.0.0.1:{self.port}/live", headers=headers)
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


def test_the_page_is_served_with_headers_that_let_nothing_in():
    async def test(served):
        for path in ("/", "/style.css", "/page.js", "/uplot.js"):
            found = await served.get(path)
            assert found.code == 200
            assert found.body == page_files()[path].data
            policy = found.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy
            assert "unsafe" not in policy
            assert found.headers["X-Content-Type-Options"] == "nosniff"
            assert "Server" not in found.headers

    serving(test)


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../etc/passwd",
        "/..%2f..%2fetc/passwd",
        "/%2e%2e/pyproject.toml",
        "//etc/passwd",
        "/vendor/LICENSE",
        "/index.html",
        "/report-.html",
        "/page.js/",
        "/\x00",
    ],
)
def test_paths_that_are_none_of_the_page_do_not_exist(path):
    async def test(served):
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        writer.write(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nConnection: close\r\n\r\n".encode()
        )
        answer = await reader.read()
        writer.close()
        assert answer.split()[1] in (b"404", b"400")
        assert b"root:" not in answer
        assert b"Traceback" not in answer

    serving(test)


def test_another_host_is_not_answered():
    async def test(served):
        found = await served.get("/", Host=f"evil.example:{served.port}")
        assert found.code == 403
        await served.until(lambda: served.gateway.refused["requests to another host"] == 1)

    serving(test)


@pytest.mark.parametrize("token", ["", "x" * 43])
def test_nobody_gets_in_without_a_token(token):
    async def test(served):
        with pytest.raises(HTTPClientError, match="403"):
            await served.connect(token)
        assert served.gateway.refused == {"connections without the token": 1}
        assert not served.gateway.clients

    serving(test)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:1", "http://["]
)
def test_pages_of_another_origin_do_not_get_in(origin):
    async def test(served):
        with pytest.raises(HTTPClientError, match="403"):
            await served.connect(Origin=origin)
        assert served.gateway.refused == {"pages of another origin": 1}
        own = await served.connect(Origin=f"http://localhost:{served.port}")
        assert (await words(own, "hello"))["control"]
        assert own.selected_subprotocol == NAME  # the token is not repeated

    serving(test)


def test_a_page_for_watching_sees_everything_and_does_nothing():
    async def test(served):
        page = await served.connect(served.tokens.watch)
        assert not (await words(page, "hello"))["control"]
        assert (await words(page, "stream"))["columns"] == ["t", "v"]
        page.write_message('{"kind": "reset", "number": 5}')
        answer = await words(page, "answer")
        assert (answer["number"], answer["ok"]) == (5, False)
        assert served.feed.asked == []
        assert served.gateway.refused == {"requests of pages that may only watch": 1}

    serving(test)


def test_requests_are_answered_in_the_words_of_who_refused_them():
    async def test(served):
        page = await served.connect()
        page.write_message('{"kind": "reset", "number": 1}')
        assert await words(page, "answer") == {
            "kind": "answer", "number": 1, "ok": True, "text": "done",
        }  # fmt: skip
        page.write_message('{"kind": "pause", "on": true, "number": 2}')
        answer = await words(page, "answer")
        assert (answer["ok"], answer["text"]) == (False, "no: it does not stand still")
        page.write_message('{"kind": "stop", "number": 3}')  # not stoppable: the feed is asked
        assert (await words(page, "answer"))["ok"]
        assert served.said == []

    serving(test)


def test_a_run_that_was_started_from_here_is_stopped_from_the_page():
    async def test(served):
        page = await served.connect()
        page.write_message('{"kind": "stop", "number": 3}')
        assert (await words(page, "answer"))["ok"]
        assert served.said == ["stop"]
        served.gateway.show_report(PageFile("text/html", b"<p>report</p>"))
        told = await served.until_report(page)
        found = await served.get(told)
        assert found.body == b"<p>report</p>"
        assert served.said == ["stop"]  # the page is still there: it may not have it yet
        page.close()
        await served.until(lambda: served.said == ["stop", "shown"])

    async def until_report(page):
        while not (path := (await words(page, "gateway"))["report"]):
            pass
        return path

    async def with_report(served):
        served.until_report = until_report
        await test(served)

    serving(with_report, stoppable=True)


def test_one_client_pushes_at_a_time():
    async def test(served):
        first, second = await served.connect(), await served.connect()
        names = [(await words(page, "hello"))["client"] for page in (first, second)]
        push = '{"kind": "push", "force": 0, "torque": %g, "stamp": 0}'
        first.write_message(push % 5.0)
        await served.until(lambda: len(served.feed.asked) == 1)
        second.write_message(push % 5.0)
        answer = await words(second, "answer")
        assert (answer["ok"], answer["text"]) == (False, "somebody else is pushing")
        first.write_message(push % 0.0)  # it lets go
        await served.until(lambda: len(served.feed.asked) == 2)
        second.write_message(push % 3.0)
        await served.until(lambda: len(served.feed.asked) == 3)
        assert [client for client, _ in served.feed.asked] == [names[0], names[0], names[1]]
        second.close()  # and who leaves lets go
        await served.until(lambda: len(served.gateway.clients) == 1)
        first.write_message(push % 1.0)
        await served.until(lambda: len(served.feed.asked) == 4)

    serving(test)


@pytest.mark.parametrize("text", ["{", "[]", '{"kind": "nonsense"}', '{"kind": "push"}', b"\x00"])
def test_nonsense_is_counted_and_the_page_stays(text):
    async def test(served):
        page = await served.connect()
        page.write_message(text, binary=isinstance(text, bytes))
        assert not (await words(page, "answer"))["ok"]
        assert served.gateway.refused == {"malformed messages": 1}
        page.write_message('{"kind": "reset", "number": 1}')
        assert (await words(page, "answer"))["ok"]

    serving(test)


def test_a_message_of_a_megabyte_ends_its_connection_alone():
    async def test(served):
        page, other = await served.connect(), await served.connect()
        await page.write_message("x" * 1_000_000)
        await served.until(lambda: len(served.gateway.clients) == 1)
        assert served.gateway.refused["messages too long"] == 1
        other.write_message('{"kind": "reset", "number": 1}')
        assert (await words(other, "answer"))["ok"]

    serving(test)


def test_a_flood_is_cut_off():
    async def test(served):
        page, other = await served.connect(), await served.connect()
        for _ in range(10_000):
            page.write_message('{"kind": "reset", "number": 1}')
        await served.until(lambda: len(served.gateway.clients) == 1)
        refused = served.gateway.refused["messages faster than a page sends them"]
        assert 1000 < refused <= 10_000
        assert len(served.feed.asked) < 10_000
        before = len(served.feed.asked)
        other.write_message('{"kind": "reset", "number": 1}')
        assert (await words(other, "answer"))["ok"]
        assert len(served.feed.asked) == before + 1

    serving(test)


def test_pushes_that_come_late_and_all_at_once_keep_nothing_from_being_done():
    async def test(served):
        page = await served.connect()
        push = '{"kind": "push", "force": 0, "torque": 0, "stamp": 0}'
        for _ in range(100):  # what a page sends in a second in which the gateway had no processor
            page.write_message(push)
        page.write_message('{"kind": "reset", "number": 1}')
        answer = await words(page, "answer")
        assert (answer["number"], answer["ok"]) == (1, True), answer["text"]
        assert served.gateway.refused == {}

    serving(test)


def test_what_is_asked_for_too_fast_is_refused_and_not_left_unanswered():
    async def test(served):
        page = await served.connect()
        push = '{"kind": "push", "force": 0, "torque": 0, "stamp": 0}'
        for _ in range(1200):  # not yet sent away
            page.write_message(push)
        page.write_message('{"kind": "reset", "number": 1}')
        answer = await words(page, "answer")
        assert (answer["number"], answer["ok"]) == (1, False)
        assert answer["text"] == "busy: too much was asked at once; ask again"
        assert served.gateway.refused["messages faster than a page sends them"] > 1

    serving(test)


def test_a_page_waits_for_what_it_has_asked_before():
    async def test(served):
        page = await served.connect()
        served.feed.hold = asyncio.Event()
        for number in range(20):
            page.write_message(f'{{"kind": "reset", "number": {number + 1}}}')
        refused = [await words(page, "answer") for _ in range(12)]
        assert {answer["text"] for answer in refused} == {"busy: wait for what was asked before"}
        served.feed.hold.set()
        done = [await words(page, "answer") for _ in range(8)]
        assert all(answer["ok"] for answer in done)
        page.write_message('{"kind": "reset", "number": 99}')
        assert (await words(page, "answer"))["ok"]

    serving(test)


def test_who_only_watches_leaves_places_for_who_controls():
    async def test(served):
        while len(served.gateway.clients) < MOST_CLIENTS - 4:
            await served.connect(served.tokens.watch)
        with pytest.raises(HTTPClientError, match="503"):
            await served.connect(served.tokens.watch)
        assert (await words(await served.connect(), "hello"))["control"]

    serving(test)


def test_there_is_room_for_so_many_pages_and_no_more():
    async def test(served):
        pages = [await served.connect() for _ in range(MOST_CLIENTS)]
        with pytest.raises(HTTPClientError, match="503"):
            await served.connect()
        pages[0].close()
        await served.until(lambda: len(served.gateway.clients) < MOST_CLIENTS)
        await served.connect()

    serving(test)


def test_a_page_that_does_not_read_has_no_queue_and_the_others_go_on():
    async def test(served):
        rows = served.feed.streams[0].rows
        own = socket.socket()
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        own.connect(("127.0.0.1", served.port))
        reader, writer = await asyncio.open_connection(sock=own, limit=1)
        writer.write(
            (
                f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nUpgrade: websocket\r\n"
                "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
                "Sec-WebSocket-Version: 13\r\n"
                f"Sec-WebSocket-Protocol: {NAME}, {served.tokens.control}\r\n\r\n"
            ).encode()
        )
        reader._transport.pause_reading()
        await served.until(lambda: len(served.gateway.clients) == 1)
        (stuck,) = served.gateway.clients
        other = await served.connect()
        heard = 0

        async def listen():
            nonlocal heard
            while (message := await other.read_message()) is not None:
                heard += isinstance(message, bytes)

        task = asyncio.get_running_loop().create_task(listen())
        reached, since = -1, 0
        while heard < since + 50:  # the other one gets on, this one does not
            for i in range(1000):
                rows.add((float(rows.count), float(i)))
            await asyncio.sleep(0.001)
            if stuck._rows.get(0, -1) != reached:
                reached, since = stuck._rows.get(0, -1), heard
        assert rows.count > reached + 10_000
        waiting = len(stuck._socket.ws_connection.stream._write_buffer)
        assert waiting <= 1000 * 16 + LONGEST  # one turn's, whatever came since
        task.cancel()
        writer.close()

    serving(test)
