"""The gateway's server: the page's files, and one WebSocket for each page."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketHandler

from .access import MOST_CLIENTS, Hosts, Tokens
from .clients import Client
from .feed import Feed, RefusedRequestError
from .page_files import PageFile
from .protocol import LONGEST, NAME, UNANSWERED, Asked, BadMessageError, asked

_TURN_S = 1.0 / 60.0
_PING_S = 20.0
_BODY_S = 5.0
_UNIQUE = secrets.token_hex(3)  # several gateways may serve one graph
_UNFINISHED = 8  # requests of a client
_FOR_CONTROL = 4  # places that pages which only watch do not take
_READ = 2**21  # bytes of a message, so that one that is too long is counted
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


@dataclass
class Gateway:
    """What the handlers share."""

    feed: Feed
    tokens: Tokens
    hosts: Hosts
    files: dict[str, PageFile]
    say: Callable[[str], None]  # to who has started the gateway
    stoppable: bool = False  # the run was started from here
    clients: set[Client] = field(default_factory=set)
    refused: Counter[str] = field(default_factory=Counter)
    operator: str = ""  # the client that pushes
    reports: int = 0  # how often the report was asked for
    reports_out: int = 0  # and how often it has gone out as a whole
    _report: str = ""
    _named: int = 0
    _operator_s: float = 0.0
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def server(self) -> HTTPServer:
        """Return the server, which listens nowhere yet."""
        routes = [
            (r"/live", PageSocket, {"gateway": self}),
            (r"(/.*)", PagePart, {"gateway": self}),
        ]
        application = Application(
            routes,
            websocket_max_message_size=_READ,
            websocket_ping_interval=_PING_S,
            websocket_ping_timeout=_PING_S,
            log_function=lambda handler: None,  # addresses of requests are nobody's business
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
        """Take turns, feed and pages, for ever."""
        while True:
            begun = time.monotonic()
            self.feed.turn()
            self._tell()
            if self.reports_out and self.reports_out == self.reports and not self.clients:
                self.say("shown")  # every page has it; who hears that may end this process
                self.reports_out = 0
            for client in list(self.clients):
                client.turn(self.feed)
            await asyncio.sleep(max(_TURN_S - (time.monotonic() - begun), 0.001))

    def refuse(self, what: str) -> None:
        """Count what was refused; every page shows it."""
        self.refused[what] += 1

    def show_report(self, file: PageFile) -> None:
        """Serve the report of the run that was ended, by a path that only the pages learn."""
        self._report = f"/report-{secrets.token_urlsafe(16)}.html"
        self.files[self._report] = file

    def _tell(self) -> None:
        self.feed.board.put(
            "gateway",
            clients=len(self.clients),
            operator=self.operator,
            refused=dict(self.refused),
            stoppable=self.stoppable,
            report=self._report,
        )

    def joined(self, client: Client) -> None:
        """Serve a client from now on."""
        self.clients.add(client)

    def left(self, client: Client) -> None:
        """Forget a client; what it held is free."""
        self.clients.discard(client)
        if self.operator == client.name:
            self.operator = ""

    def next_name(self) -> str:
        """Return a name for a client, new each time."""
        self._named += 1
        return f"live{_UNIQUE}-{self._named}"

    def take(self, client: Client, text: str | bytes) -> None:
        """Take a client's message, and answer it when what it asks for is done."""
        if len(text.encode() if isinstance(text, str) else text) > LONGEST:
            self.refuse("messages too long")
            client.send_away("a message too long")
            return
        if not client.rate.allows():
            self.refuse("messages faster than a page sends them")
            client.too_many()
            return
        try:
            found = asked(text)
        except BadMessageError as error:
            self.refuse("malformed messages")
            client.answer(0, False, str(error))
            return
        if not client.controls:
            self.refuse("requests of pages that may only watch")
            client.answer(found.number, False, "this address is for watching only")
            return
        if client.unfinished >= _UNFINISHED:
            self.refuse("requests of a page that waits for many others")
            client.answer(found.number, False, "busy: wait for what was asked before")
            return
        client.unfinished += 1
        task = asyncio.get_running_loop().create_task(self._do(client, found))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _do(self, client: Client, found: Asked) -> None:
        try:
            if found.kind == "push":
                self._hold(client, found)
            if found.kind == "stop" and self.stoppable:
                self.say("stop")
                text = "the run is being ended"
            else:
                text = await self.feed.ask(client.name, found)
        except RefusedRequestError as error:
            self.refuse("pushes refused" if found.kind in UNANSWERED else "requests refused")
            client.answer(found.number, False, str(error))
        else:
            if found.kind not in UNANSWERED:
                client.answer(found.number, True, text)
        finally:
            client.unfinished -= 1

    def _hold(self, client: Client, found: Asked) -> None:
        """Let one client push at a time, until it lets go or falls silent."""
        now = time.monotonic()
        if self.operator not in ("", client.name) and now - self._operator_s < 1.0:
            raise RefusedRequestError("somebody else is pushing")
        idle = found.values["force"] == 0.0 and found.values["torque"] == 0.0
        self._operator_s, self.operator = now, "" if idle else client.name


class _Checked(RequestHandler):
    """A request is answered only if it is made to us."""

    gateway: Gateway

    def initialize(self, gateway: Gateway) -> None:
        self.gateway = gateway

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        if not self.gateway.hosts.known(self.request.headers.get("Host", "")):
            self.gateway.refuse("requests to another host")
            raise HTTPError(403)

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain")
        self.finish(f"{status_code}\n")


class PagePart(_Checked):
    """The page's files, each by its one path, and nothing else."""

    async def get(self, path: str = "") -> None:
        """Answer with a file of the page."""
        found = self.gateway.files.get(path)
        if found is None:
            self.gateway.refuse("paths that do not exist")
            raise HTTPError(404)
        self.set_header("Content-Type", found.kind)
        report = path.startswith("/report-")
        self.gateway.reports += report
        if report:  # it brings its own policy, and lets nothing in or out
            self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
        await self.finish(found.data)
        self.gateway.reports_out += report


class PageSocket(_Checked, WebSocketHandler):
    """A page's connection."""

    client: Client | None = None

    def check_origin(self, origin: str) -> bool:
        """Return True for our page."""
        return self.gateway.hosts.same(origin)

    async def get(self, *args: Any, **kwargs: Any) -> None:
        """Let a page in that knows a token."""
        gateway = self.gateway
        if not gateway.hosts.same(self.request.headers.get("Origin")):
            gateway.refuse("pages of another origin")
            raise HTTPError(403)
        offered = self.request.headers.get("Sec-WebSocket-Protocol", "").replace(" ", "").split(",")
        self.may = gateway.tokens.may(offered)
        if not self.may:
            gateway.refuse("connections without the token")
            raise HTTPError(403)
        most = MOST_CLIENTS - (0 if self.may == "control" else _FOR_CONTROL)
        if len(gateway.clients) >= most:
            gateway.refuse("connections beyond the most")
            raise HTTPError(503)
        await super().get(*args, **kwargs)

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        """Return ours; the token is not repeated."""
        return NAME if NAME in subprotocols else None

    def open(self, *args: str, **kwargs: str) -> None:
        """Greet the page."""
        self.set_nodelay(True)
        self.client = Client(self.gateway.next_name(), self, self.may == "control")
        self.client.greet()
        self.gateway.joined(self.client)

    def on_message(self, message: str | bytes) -> None:
        """Take what the page says."""
        if self.client is not None:
            self.gateway.take(self.client, message)

    def on_close(self) -> None:
        """Forget the page."""
        if self.client is not None:
            self.gateway.left(self.client)
