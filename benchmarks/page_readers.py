"""Read a gateway as pages do, every frame: ``page_readers.py ADDRESS COUNT``, until standard input ends."""

from __future__ import annotations

import asyncio
import sys

from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from trunk_views.live.__main__ import give_way
from trunk_views.live.feed import NAME


async def _read(address: str, ready: asyncio.Semaphore) -> None:
    page, _, token = address.partition("#")
    request = HTTPRequest(f"ws{page.removeprefix('http')}live")
    connection = await websocket_connect(request, subprotocols=[NAME, token])
    ready.release()
    while await connection.read_message() is not None:
        pass


async def _until_input_ends(address: str, count: int) -> None:
    ready = asyncio.Semaphore(0)
    readers = [asyncio.create_task(_read(address, ready)) for _ in range(count)]
    for _ in readers:
        here = asyncio.create_task(ready.acquire())
        await asyncio.wait([here, *readers], return_when=asyncio.FIRST_COMPLETED)
        if not here.done():
            sys.exit("a page is not served")
    print("ready", flush=True)
    give_way()  # a user's browser is on another machine, or yields the processor
    stdin = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(stdin), sys.stdin
    )
    ends = asyncio.create_task(stdin.read())
    await asyncio.wait([ends, *readers], return_when=asyncio.FIRST_COMPLETED)
    if not ends.done():
        sys.exit("a page is no longer served")
    for reader in readers:
        reader.cancel()


def main() -> None:
    """Read as many times as asked."""
    asyncio.run(_until_input_ends(sys.argv[1], int(sys.argv[2])))


if __name__ == "__main__":
    main()
