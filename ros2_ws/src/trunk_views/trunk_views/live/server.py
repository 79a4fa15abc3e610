"""The gateway's server: the page's files, and one WebSocket for each page; all else is refused."""

from __future__ import annotations

import asyncio
import secrets
import time
from asyncio import Future
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from ..parts.page import STYLES, page, part, scripts
from .access import HEADERS, MOST_CLIENTS, Rate, Site, Tokens
from .feed import (
    ENDED,
    LONGEST,
    NAME,
    UNANSWERED,
    Asked,
    BadMessageError,
    Feed,
    RefusedRequestError,
    asked,
    frame,
    words,
)

_TURN_S = 1.0 / 60.0
_PING_S = 20.0
_BODY_S = 5.0
_UNIQUE = secrets.token_hex(3)  # several gateways may serve one graph
_UNFINISHED = 8  # requests of a client
_READ = 2**21  # bytes of a message, so that one that is too long is counted
_MESSAGES_A_SECOND = 300.0
_TOO_MANY = 1_000  # messages beyond the rate, after which a page is disconnected
_ANSWERS = 64  # that wait for a slow page; older ones are dropped
_FOR_CONTROL = 4  # places reserved for pages that may control
_OWN = ("wire.js", "health.js", "live.js")
_SCRIPTS = scripts(feed=["wire.js"], own=["health.js", "live.js"])
_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}


class PageFile(NamedTuple):
    """A file's type and content."""

    kind: str
    data: bytes


def page_files() -> dict[str, PageFile]:
    """Return the page's files by path."""
    own = files(__package__) / "page"
    html = page(
        "Trunk, live",
        "\n".join(f'<link rel="stylesheet" href="{_path(name)}">' for name in STYLES),
        "\n".join(f'<script src="{_path(name)}"></script>' for name in _SCRIPTS),
    )
    texts = {
        name: (own / name).read_text(encoding="utf-8") if name in _OWN else part(name)
        for name in (*STYLES, *_SCRIPTS)
    }
    return {
        "/": PageFile(_KINDS[".html"], html.encode()),
        **{
            _path(name): PageFile(_KINDS[Path(name).suffix], text.encode())
            for name, text in texts.items()
        },
    }


def _path(name: str) -> str:
    return f"/{Path(name).name}"


def report_file(path: Path) -> PageFile:
    """Return a report for the page to open. Raises OSError."""
    return PageFile(_KINDS[".html"], path.read_bytes())


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
        hello = words("hello", client=name, control=controls)
        self._answers = deque([hello], maxlen=_ANSWERS)
        self._ignored = 0
        self.unfinished = 0  # of its requests

    def answer(self, number: int, ok: bool, text: str) -> None:
        """Queue the answer to one of its messages, for its next turn."""
        self._answers.append(words("answer", number=number, ok=ok, text=text))

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


@dataclass
class Gateway:
    """What the handlers share."""

    feed: Feed
    tokens: Tokens
    site: Site
    files: dict[str, PageFile]
    say: Callable[[str], None]  # to the process that started the gateway
    stoppable: bool = False  # the run was started from here
    clients: set[Client] = field(default_factory=set)
    refused: Counter[str] = field(default_factory=Counter)
    operator: str = ""  # the client that pushes
    reports: int = 0  # that are being sent
    _report: str = ""
    _over: bool = False
    _last_words: str = ""
    _said: str = ""  # of the pages that may still want the report
    named: int = 0  # clients, ever
    _operator_s: float = 0.0
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def server(self) -> HTTPServer:
        """Return the server, which does not listen yet."""
        routes = [
            (r"/live", PageSocket, {"gateway": self}),
            (r"(/.*)", PagePart, {"gateway": self}),
        ]
        application = Application(
            routes,
            websocket_max_message_size=_READ,
            websocket_ping_interval=_PING_S,
            websocket_ping_timeout=_PING_S,
            log_function=lambda handler: None,  # requested addresses are private
            default_handler_class=PagePart,
            default_handler_args={"gateway": self},
        )
        return HTTPServer(
            application,
            max_header_size=LONGEST,
            max_body_size=LONGEST,
            body_timeout=_BODY_S,
            idle_connection_timeout=60.0,
        )

    async def serve(self) -> None:
        """Serve feed and pages in turns, forever."""
        while True:
            begun = time.monotonic()
            if not self._over:  # a later run in this domain is none of its business
                self.feed.turn()
            self._show()
            if self._report:
                self._say_who_waits()
            await asyncio.sleep(max(_TURN_S - (time.monotonic() - begun), 0.001))

    def refuse(self, reason: str) -> None:
        """Count what was refused; every page shows it."""
        self.refused[reason] += 1

    def end(self, words: str) -> None:
        """Do nothing to the graph from now on. ``words``: why the run has no report; empty: it has one."""
        if not self._over:
            self.feed.turn()
        self._over, self._last_words, self.stoppable = True, words, False

    async def leave(self) -> None:
        """Tell every page that this is the end, and wait until it knows or is gone."""
        self._show()
        for client in list(self.clients):
            client.send_away("the server has ended", ENDED)
        while self.clients:  # tornado gives each that does not answer 5 s
            await asyncio.sleep(_TURN_S)

    def show_report(self, file: PageFile) -> None:
        """Serve the report of the run that was ended, by a path that only the pages learn."""
        self._report = f"/report-{secrets.token_urlsafe(16)}.html"
        self.files[self._report] = file

    def _say_who_waits(self) -> None:
        """Say whether a page has yet to fetch the report; it leaves as the report comes, or is closed."""
        word = "waiting" if self.clients or self.reports else "left"
        if word != self._said:
            self._said = word
            self.say(word)

    def _show(self) -> None:
        """Send every page what is new."""
        self.feed.board.put(
            "gateway",
            clients=len(self.clients),
            operator=self.operator,
            refused=dict(self.refused),
            stoppable=self.stoppable,
            report=self._report,
            ended=self._last_words,
        )
        for client in list(self.clients):
            client.turn(self.feed)

    def left(self, client: Client) -> None:
        """Forget a client; if it was the operator, another one may push."""
        self.clients.discard(client)
        if self.operator == client.name:
            self.operator = ""

    def take(self, client: Client, text: str | bytes) -> None:
        """Take a client's message, and answer it when what it asks for is done."""
        if len(text.encode() if isinstance(text, str) else text) > LONGEST:
            self.refuse("messages too long")
            client.send_away("a message too long")
            return
        request, wrong = None, ""
        try:
            request = asked(text)
        except BadMessageError as error:
            wrong = str(error)
        if not client.rate.allows():
            self.refuse("messages faster than a page sends them")
            if request is not None and request.kind not in UNANSWERED:
                client.answer(request.number, False, "busy: too many requests at once; ask again")
            client.too_many()
            return
        if request is None:
            self.refuse("malformed messages")
            client.answer(0, False, wrong)
            return
        if not client.controls:
            self.refuse("requests of pages that may only watch")
            client.answer(request.number, False, "this address is for watching only")
            return
        # Those that come with each picture are done at once: after a pause they arrive in bursts.
        lasting = request.kind not in UNANSWERED
        if lasting and client.unfinished >= _UNFINISHED:
            self.refuse("requests of a page that still waits for many others")
            client.answer(request.number, False, "busy: wait for the earlier requests")
            return
        client.unfinished += lasting
        task = asyncio.get_running_loop().create_task(self._do(client, request))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _do(self, client: Client, request: Asked) -> None:
        try:
            if self._over:
                raise RefusedRequestError("the run is over")
            if request.kind == "push":
                self._hold(client, request)
            if request.kind == "stop" and self.stoppable:
                self.say("stop")
                text = "the run is being ended"
            else:
                text = await self.feed.ask(client.name, request)
        except RefusedRequestError as error:
            self.refuse("pushes" if request.kind in UNANSWERED else "requests by pages")
            client.answer(request.number, False, str(error))
        except Exception as error:  # a fault of ours: it is logged, and nobody waits for ever
            client.answer(request.number, False, f"{request.kind} failed: {error!r}")
            raise
        else:
            if request.kind not in UNANSWERED:
                client.answer(request.number, True, text)
        finally:
            client.unfinished -= request.kind not in UNANSWERED

    def _hold(self, client: Client, request: Asked) -> None:
        """Let one client push at a time, until it lets go or sends nothing for a second."""
        now = time.monotonic()
        if self.operator not in ("", client.name) and now - self._operator_s < 1.0:
            raise RefusedRequestError("somebody else is pushing")
        idle = request.values["force"] == 0.0 and request.values["torque"] == 0.0
        self._operator_s, self.operator = now, "" if idle else client.name


class _Checked(RequestHandler):
    """Answers a request only if it is addressed to our site."""

    gateway: Gateway

    def initialize(self, gateway: Gateway) -> None:
        self.gateway = gateway

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        if not self.gateway.site.known(self.request.headers.get("Host", "")):
            self.gateway.refuse("requests to another host")
            raise HTTPError(403)

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain")
        self.finish(f"{status_code}\n")


class PagePart(_Checked):
    """The page's files, each by its one path, and nothing else."""

    async def get(self, path: str = "") -> None:
        """Answer with a file of the page."""
        file = self.gateway.files.get(path)
        if file is None:
            self.gateway.refuse("paths that do not exist")
            raise HTTPError(404)
        self.set_header("Content-Type", file.kind)
        report = path.startswith("/report-")
        self.gateway.reports += report
        if report:  # it brings its own policy, and lets nothing in or out
            self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
        try:
            await self.finish(file.data)
        finally:  # also where the page was closed meanwhile
            self.gateway.reports -= report


class PageSocket(_Checked, WebSocketHandler):
    """A page's connection."""

    client: Client | None = None

    def check_origin(self, origin: str) -> bool:
        """Return True for our page."""
        return self.gateway.site.same(origin)

    async def get(self, *args: Any, **kwargs: Any) -> None:
        """Admit a page that knows a token."""
        gateway = self.gateway
        if not gateway.site.same(self.request.headers.get("Origin")):
            gateway.refuse("pages of another origin")
            raise HTTPError(403)
        offered = self.request.headers.get("Sec-WebSocket-Protocol", "").replace(" ", "").split(",")
        self.may = gateway.tokens.may(offered)
        if not self.may:
            gateway.refuse("connections without the token")
            raise HTTPError(403)
        most = MOST_CLIENTS - (0 if self.may == "control" else _FOR_CONTROL)
        if len(gateway.clients) >= most:
            gateway.refuse("connections beyond the limit")
            raise HTTPError(503)
        await super().get(*args, **kwargs)

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        """Return ours; the token is not repeated."""
        return NAME if NAME in subprotocols else None

    def open(self, *args: str, **kwargs: str) -> None:
        """Greet the page."""
        self.set_nodelay(True)
        self.gateway.named += 1
        name = f"live{_UNIQUE}-{self.gateway.named}"
        self.client = Client(name, self, self.may == "control")
        self.gateway.clients.add(self.client)

    def on_message(self, message: str | bytes) -> None:
        """Take a message from the page."""
        if self.client is not None:
            self.gateway.take(self.client, message)

    def on_close(self) -> None:
        """Forget the page."""
        if self.client is not None:
            self.gateway.left(self.client)
