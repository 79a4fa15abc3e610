"""A page that is connected: what it has been sent, and how much it may ask for."""

from __future__ import annotations

import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING

from tornado.websocket import WebSocketClosedError

from .access import Rate
from .protocol import frame, words

if TYPE_CHECKING:
    from asyncio import Future

    from tornado.websocket import WebSocketHandler

    from .feed import Feed

_MESSAGES_A_SECOND = 300.0
_TOO_MANY = 1_000  # messages beyond the rate, after which a page is disconnected
_ANSWERS = 64  # that wait for a slow page; older ones are dropped


class Client:
    """One page. It gets the next message when it has taken the last one, so that nothing queues for it."""

    def __init__(self, name: str, socket: WebSocketHandler, controls: bool) -> None:
        self.name = name
        self.controls = controls
        self.rate = Rate(_MESSAGES_A_SECOND, time.monotonic)
        self._socket = socket
        self._sent: Future[None] | None = None
        self._version = 0
        self._rows: dict[int, int] = {}  # stream -> the number of the next row
        self._answers: deque[str] = deque(maxlen=_ANSWERS)
        self._ignored = 0
        self.unfinished = 0  # of its requests

    def answer(self, number: int, ok: bool, text: str) -> None:
        """Queue the answer to one of its messages, for its next turn."""
        self._answers.append(words("answer", number=number, ok=ok, text=text))

    def greet(self, **values: object) -> None:
        """Queue the first message."""
        self._answers.append(words("hello", client=self.name, control=self.controls, **values))

    def too_many(self) -> None:
        """Disconnect a page that keeps sending more than a page of ours does."""
        self._ignored += 1
        if self._ignored > _TOO_MANY:
            self.send_away("too many messages")

    def send_away(self, why: str, code: int = 1008) -> None:
        """End its connection."""
        self._socket.close(code, why)

    def turn(self, feed: Feed) -> None:
        """Send what is new, unless the page has not taken the last message yet."""
        if self._sent is not None and not self._sent.done():
            return
        while self._answers:
            self._send(self._answers.popleft())
        while (piece := feed.board.after(self._version)) is not None:
            self._version, text = piece
            self._send(text)
        for number, stream in enumerate(feed.streams):
            data, after = frame(number, stream.rows, self._rows.get(number, 0))
            if data:
                self._rows[number] = after
                self._send(data)

    def _send(self, data: str | bytes) -> None:
        with suppress(WebSocketClosedError):
            self._sent = self._socket.write_message(data, binary=isinstance(data, bytes))
            # It may fail as the page leaves; its exception has to be looked at.
            self._sent.add_done_callback(lambda sent: sent.cancelled() or sent.exception())
