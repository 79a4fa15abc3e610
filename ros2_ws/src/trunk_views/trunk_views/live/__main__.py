"""The gateway's process: standard input says what to show, and ends it."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path

from .access import Site, Tokens
from .graph_feed_node import GraphFeed
from .server import Gateway, page_files, report_file

# A third of what others get on a busy machine: enough to keep a page alive.
_NICE = 5
# Linux shares the processors among sessions first, and only within one by the processes' own priorities.
_OF_THE_SESSION = Path("/proc/self/autogroup")


def main() -> None:
    """Serve until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process decides when it ends
    logging.getLogger("tornado").setLevel(logging.CRITICAL)  # the log cannot be filled from outside
    asyncio.run(_serve())


async def _serve() -> None:
    loop = asyncio.get_running_loop()
    stdin = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdin), sys.stdin)
    first = json.loads(await stdin.readline())
    feed = GraphFeed(first["namespace"], first.get("standby", ()))
    gateway = Gateway(
        feed,
        Tokens(*first["tokens"]),
        Site.at(first["url"]),
        page_files(),
        _say,
        first.get("stoppable", False),
    )
    server = gateway.server()
    listening = socket.socket(fileno=os.dup(first["socket"]))
    listening.setblocking(False)
    server.add_socket(listening)
    give_way()  # not before: starting takes a second of processor time
    listens = loop.create_task(_listen(stdin, gateway))
    works = [loop.create_task(gateway.serve()), loop.create_task(feed.begin())]
    try:
        # It ends with its input, or when one of its tasks fails.
        left = {listens, *works}
        while listens in left:
            done, left = await asyncio.wait(left, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
    finally:
        server.stop()
        feed.close()


async def _listen(stdin: asyncio.StreamReader, gateway: Gateway) -> None:
    while line := await stdin.readline():
        more = json.loads(line)
        gateway.end(more["over"])
        if "report" in more:
            gateway.show_report(report_file(Path(more["report"])))
    await gateway.leave()


def _say(word: str) -> None:
    sys.stdout.write(word + "\n")
    sys.stdout.flush()


def give_way() -> None:
    """Lower the priority of this process, and of its session, which it must not share."""
    with suppress(OSError):
        os.nice(_NICE)
    with suppress(OSError):
        _OF_THE_SESSION.write_text(str(_NICE), "ascii")


if __name__ == "__main__":
    main()
