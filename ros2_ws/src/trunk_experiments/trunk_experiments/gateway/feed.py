"""What the gateway shows, whatever it comes from: a running graph, or a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from trunk_msgs_util.errors import TrunkError

from .board import Board
from .rows import StreamRows

if TYPE_CHECKING:
    from .protocol import Asked

PLANT = "plant"  # the name of the stream of true states
PUSHES = "pushes"  # of what was taken from an operator


class RefusedRequestError(TrunkError):
    """A page's request that is refused, and why."""


class Stream(NamedTuple):
    """Rows with their name: ``plant``, ``pushes``, or a controller's."""

    name: str
    rows: StreamRows


class Feed(Protocol):
    """A source of streams and texts."""

    board: Board
    streams: list[Stream]

    async def begin(self) -> None:
        """Do what is needed only once, while turns are taken."""

    def turn(self) -> None:
        """Take what has come since the last turn; never waits."""

    async def ask(self, client: str, asked: Asked) -> str:
        """Do what a client asks for; return the answer. Raises RefusedRequestError."""

    def close(self) -> None:
        """Release what was opened."""


def put_stream(board: Board, streams: list[Stream], name: str, rows: StreamRows) -> None:
    """Open a stream, and announce it."""
    board.put("stream", name, stream=len(streams), columns=list(rows.names))
    streams.append(Stream(name, rows))
