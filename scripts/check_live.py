"""What pages, good ones and bad ones, do to a running loop: nothing; and the gateway's memory stays flat.

    source scripts/env.sh && python scripts/check_live.py [--minutes 10] [--rate 200] [--seconds 20]

One graph runs in real time, with a recorder; four pages read all there is. Its loop is measured alone, with
the pages, and while others try to get past the gateway: no token, another origin, `..` in paths, malformed
JSON, messages of 1 MB, 10,000 messages a second, and a page that stops reading for a minute. Then the pages
read on to the end; from the second minute on the gateway's memory (RSS) may grow by less than 5 %.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import Any

import click
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClosedError, websocket_connect

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.nodes import LATENCY, begin, graph_of, readers, resident_bytes, timing
from benchmarks.observer import Observer

from trunk_core import topics
from trunk_evidence.judgement import VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.console.tables import print_table
from trunk_runs.processes import stop
from trunk_views.live.feed import NAME
from trunk_views.live.process import LOOPBACK, GatewayProcess

MIB = 2**20
MOST = 0.05
TOPICS = (topics.JOINT_STATES, topics.EFFORT_COMMAND)
LATE = "latency, 99 %"
COLUMNS = ("while", "states", "missed", "unanswered", "median, us", "99 %, us", "outcome")
STOPPED_S = 60.0
Attack = Callable[[str, str], Awaitable[str]]


async def _connected(page: str, token: str, heard: Any = None, **headers: str) -> Any:
    request = HTTPRequest(f"ws{page.removeprefix('http')}live", headers=headers)
    return await websocket_connect(request, subprotocols=[NAME, token], on_message_callback=heard)


async def no_token(page: str, token: str) -> str:
    """Connect without a token, with a wrong one, and from another site's page."""
    codes = []
    for given, headers in (("", {}), ("x" * 43, {}), (token, {"Origin": "http://evil.example"})):
        try:
            await _connected(page, given, None, **headers)
            codes.append("ACCEPTED")
        except HTTPClientError as error:
            codes.append(str(error.code))
    return " ".join(codes)


async def paths(page: str, token: str) -> str:
    """Ask for files that are not the page's."""
    codes = set()
    for path in ("../../etc/passwd", "%2e%2e/%2e%2e/etc/passwd", "vendor/../../main.py", "main.py"):
        try:
            await AsyncHTTPClient().fetch(page + path)
            codes.add("ACCEPTED")
        except HTTPClientError as error:
            codes.add(str(error.code))
    return " ".join(sorted(codes))


async def malformed(page: str, token: str) -> str:
    """Send malformed requests: a thousand, or until disconnected."""
    socket = await _connected(page, token)
    for number in range(1000):
        await socket.write_message(["{", "[]", '{"kind": "push"}', "\0", "null"][number % 5])
    answers = 0
    while answers < 100 and await socket.read_message() is not None:
        answers += 1
    socket.close()
    return "refused, each with a message"


async def megabytes(page: str, token: str) -> str:
    """Send messages of 1 MB, each by a new page."""
    for _ in range(20):
        socket = await _connected(page, token)
        with suppress(WebSocketClosedError):
            await socket.write_message("x" * 1_000_000)
        while await socket.read_message() is not None:
            pass
    return "disconnected, 20 of 20"


async def flood(page: str, token: str) -> str:
    """Send 10,000 messages a second for 3 s, by a new page each time one is disconnected."""
    away, sent, until = 0, 0, time.monotonic() + 3.0
    text = '{"kind": "push", "number": 1, "force": 0, "torque": 9e9}'
    socket = await _connected(page, token, lambda message: None)
    while time.monotonic() < until:
        try:
            for _ in range(100):
                await socket.write_message(text)
            sent += 100
            await asyncio.sleep(0.01)
        except WebSocketClosedError:
            away += 1
            with suppress(HTTPClientError):
                socket = await _connected(page, token, lambda message: None)
    socket.close()
    return f"{sent} sent, disconnected {away} times"


async def stops_reading(page: str, token: str) -> str:
    """Read, stop for a minute, and read on; reconnect if disconnected, as our page does."""
    socket = await _connected(page, token)
    for _ in range(20):
        await socket.read_message()
    await asyncio.sleep(STOPPED_S)
    began, read, away = time.monotonic(), 0, 0
    while time.monotonic() < began + 2.0:
        if await socket.read_message() is None:
            away += 1
            socket = await _connected(page, token)
        else:
            read += 1
    socket.close()
    return f"disconnected {away} times, then read on: {read} messages in 2 s"


ATTACKS: dict[str, Attack] = {
    "no token, another origin": no_token,
    "paths with ..": paths,
    "malformed JSON": malformed,
    "messages of 1 MB": megabytes,
    "10,000 messages/s": flood,
    "a page that stops reading": stops_reading,
}


class Loop:
    """The loop, second by second: when its states and their answers were written."""

    def __init__(self, observer: Observer, rate: float) -> None:
        self._observer, self._rate = observer, rate
        self.rows: list[tuple[str, ...]] = []
        self._forget()

    def _forget(self) -> None:
        self._written: dict[str, dict[int, int]] = {topic: {} for topic in TOPICS}

    def look(self) -> None:
        """Watch it for a second."""
        self._observer.watch(1.0, lambda: None)
        for topic, written_ns in self._observer.written_ns.items():
            self._written[topic] |= written_ns

    def note(self, what: str, came: str = "") -> None:
        """Keep the measures of what was seen since the last note."""
        found = timing(*self._written.values(), self._rate)
        shown = (found["missed steps"], found["unanswered"], found[LATENCY], found[LATE])
        states = len(self._written[TOPICS[0]])
        self.rows.append((what, str(states), *(f"{value:.0f}" for value in shown), came))
        self._forget()


def attack(name: str, address: str, look: Callable[[], object]) -> str:
    """Attack from a separate process, and look meanwhile; return what it printed."""
    command = [sys.executable, __file__, "--attack", name, address]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        while process.poll() is None:
            look()
        assert process.stdout is not None
        return process.stdout.read().strip()


def check(minutes: float, rate: float, seconds: int, folder: Path) -> list[str]:
    """Run the graph, print what was seen, and return what is wrong."""
    wrong: list[str] = []
    memory: list[tuple[float, int]] = []
    log = folder / "gateway.log"
    way = graph_of("fuzzy_pid", rate, recorded=True)
    with way.started(folder / "run") as running, Observer(TOPICS) as observer:
        begin(running, observer, seconds)
        began, loop = time.monotonic(), Loop(observer, rate)
        for _ in range(seconds):
            loop.look()
        loop.note("alone")
        gateway = GatewayProcess(log, LOOPBACK, 0, {"namespace": ""})
        pid = gateway.pid

        def look() -> None:
            loop.look()
            memory.append((time.monotonic() - began, resident_bytes(pid)))

        try:
            with readers(gateway, log, 4):
                for _ in range(seconds):
                    look()
                loop.note("four pages")
                for name in ATTACKS:
                    came = attack(name, gateway.address(gateway.tokens.control), look)
                    loop.note(name, came)
                    if "ACCEPTED" in came or not came:
                        wrong.append(f"{name}: {came or 'it ended without reporting anything'}")
                until = max(began + 60.0 * minutes, time.monotonic() + seconds)
                while time.monotonic() < until:
                    look()
                loop.note("four pages")
                gateway.words()
        finally:
            gateway.close()
        for _ in range(seconds):
            loop.look()
        loop.note("alone")
        for process in running:  # the simulator first, so that the others' evidence is whole
            stop([process], [])
    print_table("the loop", COLUMNS, loop.rows, sentences=True)
    settled = [size for t, size in memory if t >= min(120.0, 30.0 * minutes)]
    first, most = median(settled[: max(len(settled) // 10, 1)]), max(settled)
    print(f"the gateway's memory: {first / MIB:.1f} MiB, later at most {most / MIB:.1f} MiB")
    if most > (1.0 + MOST) * first:
        wrong.append(f"the gateway's memory grew by {100.0 * (most / first - 1.0):.1f} %")
    found = verdict_on(RecordedRun.open(folder / "run" / "run.mcap"))
    if found.exit_code != VERIFIED:
        wrong.append(f"the recording: {'; '.join(found.reasons)}")
    return wrong


@click.command(help=__doc__)
@click.option("--minutes", default=10.0)
@click.option("--rate", default=200.0)
@click.option("--seconds", default=20, help="How long the loop is measured alone.")
@click.option("--attack", "named", nargs=2, default=None, hidden=True)
def main(minutes: float, rate: float, seconds: int, named: tuple[str, str] | None) -> None:
    if named is not None:
        page, _, token = named[1].partition("#")
        print(asyncio.run(ATTACKS[named[0]](page, token)))
        return
    with tempfile.TemporaryDirectory(prefix="trunk_live_") as folder:
        wrong = check(minutes, rate, seconds, Path(folder))
    for line in wrong:
        print(f"WRONG: {line}")
    print("check_live: " + ("FAILED" if wrong else "passed"))
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
