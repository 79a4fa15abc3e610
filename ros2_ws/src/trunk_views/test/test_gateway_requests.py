"""What pages may ask of the gateway, against nonsense, floods and pages that do not read."""

import asyncio
import json
import socket
from functools import partial
from itertools import count
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.pid import PidConfig
from trunk_core.parameters.declarations import values_of
from trunk_recording.schemas import event as encoded
from trunk_sim.config import TrunkSimulator
from trunk_views.live import server
from trunk_views.live.access import Rate
from trunk_views.live.feed import ENDED, LONGEST, NAME, Asked, Board, RefusedRequestError
from trunk_views.live.graph_state import Graph
from trunk_views.live.server import PageFile

from .gateway_served import serving, words


def test_requests_are_answered_and_refusals_passed_on_word_for_word():
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


def test_a_request_that_fails_unforeseen_is_answered_too():
    async def test(served):
        async def ask(client, asked):
            raise KeyError("pid")

        served.feed.ask = ask
        page = await served.connect()
        page.write_message('{"kind": "swap", "to": "pid", "number": 1}')
        answer = await words(page, "answer")
        assert (answer["ok"], answer["text"]) == (False, "swap failed: KeyError('pid')")

    serving(test)


def test_a_stoppable_run_is_stopped_from_the_page():
    async def test(served):
        page = await served.connect()
        page.write_message('{"kind": "stop", "number": 3}')
        assert (await words(page, "answer"))["ok"]
        assert served.said == ["stop"]
        served.gateway.end("")
        served.gateway.show_report(PageFile("text/html", b"<p>report</p>"))
        told = await served.until_report(page)
        found = await served.get(told)
        assert found.body == b"<p>report</p>"
        assert (
            found.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
        )  # it has its own
        assert served.said == ["stop", "waiting"]  # the page is there: it may not have it yet
        page.close()
        await served.until(lambda: served.said == ["stop", "waiting", "left"])

    async def until_report(page):
        while not (path := (await words(page, "gateway"))["report"]):
            pass
        return path

    async def with_report(served):
        served.until_report = until_report
        await test(served)

    serving(with_report, stoppable=True)


def test_nobody_waits_for_a_page_that_was_closed_before_its_report_was_there():
    async def test(served):
        page = await served.connect()
        page.write_message('{"kind": "stop", "number": 3}')
        await served.until(lambda: served.said == ["stop"])
        page.close()
        await served.until(lambda: not served.gateway.clients)
        served.gateway.end("")
        served.gateway.show_report(PageFile("text/html", b"<p>report</p>"))
        await served.until(lambda: served.said == ["stop", "left"])

    serving(test, stoppable=True)


def test_nobody_waits_for_a_page_that_is_closed_while_its_report_is_sent():
    async def test(served):
        long = PageFile("text/html", bytes(2**26))  # more than the network takes at once
        served.gateway.end("")
        page = await served.connect()
        served.gateway.show_report(long)
        while not (path := (await words(page, "gateway"))["report"]):
            pass
        _, report = await asyncio.open_connection("127.0.0.1", served.port)
        report.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n\r\n".encode())
        await served.until(lambda: served.gateway.reports == 1)
        page.close()
        await served.until(lambda: not served.gateway.clients)
        assert served.said == ["waiting"]
        report.close()
        await served.until(lambda: served.said == ["waiting", "left"])

    serving(test)


def test_a_run_that_is_over_takes_no_request_and_every_page_learns_why_it_has_no_report():
    async def test(served):
        page = await served.connect()
        turns = []
        served.feed.turn = lambda: turns.append("turn")
        served.gateway.end("stopped by request before the run began")
        page.write_message('{"kind": "reset", "number": 1}')
        answer = await words(page, "answer")
        assert (answer["ok"], answer["text"]) == (False, "the run is over")
        assert (served.feed.asked, turns) == ([], ["turn"])  # what comes later is another run's
        leaves = asyncio.get_running_loop().create_task(served.gateway.leave())
        last = {}
        while (message := await page.read_message()) is not None:
            if isinstance(message, str) and json.loads(message)["kind"] == "gateway":
                last = json.loads(message)
        assert last["ended"] == "stopped by request before the run began"
        assert (last["stoppable"], last["report"]) == (False, "")
        assert page.close_code == ENDED
        await leaves

    serving(test, stoppable=True)


def test_one_client_pushes_at_a_time(monkeypatch):
    still = SimpleNamespace(monotonic=lambda: 0.0)  # however long there is between two pushes
    monkeypatch.setattr(server, "time", still)

    async def test(served):
        first, second = await served.connect(), await served.connect()
        names = [(await words(page, "hello"))["client"] for page in (first, second)]
        push = '{"kind": "push", "force": 0, "torque": %g}'
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
        second.close()  # and leaving lets go
        await served.until(lambda: len(served.gateway.clients) == 1)
        first.write_message(push % 1.0)
        await served.until(lambda: len(served.feed.asked) == 4)

    serving(test)


def test_who_has_pushed_nothing_for_a_second_has_let_go(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(server, "time", SimpleNamespace(monotonic=lambda: now[0]))

    async def test(served):
        asked, refused = served.feed.asked, served.gateway.refused
        pages, done = [await served.connect() for _ in range(2)], []
        for now[0], who in ((0.0, 0), (0.75, 0), (1.5, 1), (1.75, 1), (2.5, 0)):
            count = len(asked) + refused["pushes"]
            pages[who].write_message('{"kind": "push", "force": 0, "torque": 5}')
            await served.until(lambda n=count: len(asked) + refused["pushes"] > n)
            done.append(len(asked))
        assert done == [1, 2, 2, 3, 3]

    serving(test)


@pytest.fixture
def node(monkeypatch):
    """Return the module of what talks to a graph, without any graph."""
    module = pytest.importorskip("trunk_views.live.graph_feed_node")
    for name in ("rclpy", "middleware", "Node", "SingleThreadedExecutor"):
        monkeypatch.setattr(module, name, MagicMock())
    return module


def test_a_swap_whose_second_half_fails_gives_the_turn_back(node, monkeypatch):
    graph, asked = Graph(Board()), []
    for name, config, event in (
        ("pid", PidConfig(), "activated"),
        ("fuzzy_pid", FuzzyPidConfig(), "configured"),
        ("simulator", TrunkSimulator(lockstep=True), "started"),
    ):
        graph.parameters(name, values_of(config))
        graph.event(name, 0, event, {})

    async def call(_, kind, name, request, happened=None):
        asked.append((name, request.data if name == "simulator" else request.transition.id))
        if asked[-1] == ("fuzzy_pid", node.Transition.TRANSITION_ACTIVATE):
            raise RefusedRequestError("fuzzy_pid did not answer")
        return SimpleNamespace(success=True, message="")

    monkeypatch.setattr(node.GraphRequests, "call", call)
    swap = node.GraphRequests(graph, None, "").ask("", Asked("swap", 1, {"to": "fuzzy_pid"}))
    with pytest.raises(RefusedRequestError, match="fuzzy_pid did not answer"):
        asyncio.run(swap)
    on, off = node.Transition.TRANSITION_ACTIVATE, node.Transition.TRANSITION_DEACTIVATE
    turns = [("pid", off), ("fuzzy_pid", on), ("pid", on)]
    assert asked == [("simulator", True), *turns, ("simulator", False)]


def test_infinity_is_set_as_a_number_and_a_pause_may_be_refused(node, monkeypatch):
    graph, asked = Graph(Board()), []
    graph.parameters("pid", values_of(PidConfig()))

    async def call(_, kind, name, request, happened=None):
        asked.append(request)
        return MagicMock(success=False, message="no run to pause")

    monkeypatch.setattr(node.GraphRequests, "call", call)
    requests = node.GraphRequests(graph, None, "")
    asyncio.run(requests.set("pid", {"u_clamp_max": "inf"}))
    (sent,) = asked[0].parameters
    assert (sent.name, sent.value.double_value) == ("u_clamp_max", float("inf"))
    with pytest.raises(RefusedRequestError, match=r"^simulator: no run to pause$"):
        asyncio.run(requests.ask("", Asked("pause", 2, {"on": True})))


@pytest.mark.parametrize(
    ("kind", "name", "again"),
    [
        ("Trigger", "pid", False),
        ("ChangeState", "pid", False),
        ("SetBool", "simulator", True),
        ("SetParametersAtomically", "pid", True),
    ],
)
def test_only_what_may_be_done_twice_is_asked_again(node, monkeypatch, kind, name, again):
    graph = Graph(Board())
    graph.parameters("pid", values_of(PidConfig()))
    looks = count()
    monkeypatch.setattr(node, "time", SimpleNamespace(monotonic=lambda: 0.6 * next(looks)))
    client = node.Node.return_value.create_client.return_value
    client.call_async.return_value.done = lambda: next(looks) > 20
    kind = getattr(node, kind)
    asyncio.run(node.GraphRequests(graph, None, "").call(kind, name, kind.Request()))
    assert (client.call_async.call_count > 1) == again


def test_a_node_that_never_answers_is_given_up(node, monkeypatch):
    graph = Graph(Board())
    graph.parameters("pid", values_of(PidConfig()))
    clock = count(0.0, 5.0).__next__
    monkeypatch.setattr(node, "Deadline", partial(node.Deadline, clock=clock))
    node.Node.return_value.create_client.return_value.call_async.return_value.done = lambda: False
    swap = node.GraphRequests(graph, None, "").ask("", Asked("swap", 1, {"to": "pid"}))
    with pytest.raises(RefusedRequestError, match=r"^pid did not answer within 10 s$"):
        asyncio.run(swap)


def test_another_robots_nodes_of_the_same_names_are_not_shown(node):
    told = iter(f"{space}/simulator" for space in ("/a", "/b", "", "/a/b"))

    def subscription(kind, topic, *_, **__):
        def take(*_):
            name = next(told, None) if topic == "/diagnostics" else None
            return name and (deserialize(encoded(0, name, "ok", {"of": name}), DiagnosticArray), {})

        return MagicMock(**{"handle.take_message": take})

    deserialize = pytest.importorskip("rclpy.serialization").deserialize_message
    DiagnosticArray = pytest.importorskip("diagnostic_msgs.msg").DiagnosticArray
    node.Node.return_value.create_subscription = subscription
    feed = node.GraphFeed("/a")
    feed.graph.parameters("simulator", values_of(TrunkSimulator()))
    feed.turn()
    assert feed.graph.nodes["simulator"].health == {"of": "/a/simulator"}


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


def test_a_message_of_a_megabyte_ends_only_its_connection():
    async def test(served):
        page, other = await served.connect(), await served.connect()
        await page.write_message("x" * 1_000_000)
        await served.until(lambda: len(served.gateway.clients) == 1)
        assert served.gateway.refused["messages too long"] == 1
        other.write_message('{"kind": "reset", "number": 1}')
        assert (await words(other, "answer"))["ok"]

    serving(test)


def without_more_tokens(served):
    """Let no time pass for the limits of the pages' requests, however slow this process is."""
    for client in served.gateway.clients:
        client.rate = Rate(300.0, lambda: 0.0)


@pytest.mark.slow
def test_a_flood_is_cut_off():
    async def test(served):
        page, other = await served.connect(), await served.connect()
        without_more_tokens(served)
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


def test_a_burst_of_late_pushes_does_not_block_other_requests():
    async def test(served):
        page = await served.connect()
        push = '{"kind": "push", "force": 0, "torque": 0}'
        for _ in range(100):  # a second of pushes while the gateway got no processor time
            page.write_message(push)
        page.write_message('{"kind": "reset", "number": 1}')
        answer = await words(page, "answer")
        assert (answer["number"], answer["ok"]) == (1, True), answer["text"]
        assert served.gateway.refused == {}

    serving(test)


def test_requests_sent_too_fast_are_refused_with_an_answer():
    async def test(served):
        page = await served.connect()
        push = '{"kind": "push", "force": 0, "torque": 0}'
        without_more_tokens(served)
        for _ in range(1200):  # not yet disconnected
            page.write_message(push)
        page.write_message('{"kind": "reset", "number": 1}')
        answer = await words(page, "answer")
        assert (answer["number"], answer["ok"]) == (1, False)
        assert answer["text"] == "busy: too many requests at once; ask again"
        assert served.gateway.refused["messages faster than a page sends them"] > 1

    serving(test)


def test_a_page_has_to_wait_for_its_earlier_requests():
    async def test(served):
        page = await served.connect()
        served.feed.hold = asyncio.Event()
        for number in range(20):
            page.write_message(f'{{"kind": "reset", "number": {number + 1}}}')
        refused = [await words(page, "answer") for _ in range(12)]
        assert {answer["text"] for answer in refused} == {"busy: wait for the earlier requests"}
        served.feed.hold.set()
        done = [await words(page, "answer") for _ in range(8)]
        assert all(answer["ok"] for answer in done)
        page.write_message('{"kind": "reset", "number": 99}')
        assert (await words(page, "answer"))["ok"]

    serving(test)


def by_hand(served):
    """Return what a page says that opens its connection itself; it answers no ping."""
    return (
        f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        "Sec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Protocol: {NAME}, {served.tokens.control}\r\n\r\n"
    ).encode()


def test_a_page_that_was_lost_without_a_word_gives_its_place_back(monkeypatch):
    monkeypatch.setattr(server, "_PING_S", 0.05)

    async def test(served):
        _, writer = await asyncio.open_connection("127.0.0.1", served.port)
        writer.write(by_hand(served))
        await served.until(lambda: served.gateway.named)
        await served.until(lambda: not served.gateway.clients)
        writer.close()

    serving(test)


@pytest.mark.slow
def test_a_page_that_does_not_read_has_no_queue_and_the_others_go_on(monkeypatch):
    monkeypatch.setattr(server, "_PING_S", 0.0)  # it would answer no ping

    async def test(served):
        rows = served.feed.streams[0].rows
        own = socket.socket()
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        own.connect(("127.0.0.1", served.port))
        reader, writer = await asyncio.open_connection(sock=own, limit=1)
        writer.write(by_hand(served))
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
