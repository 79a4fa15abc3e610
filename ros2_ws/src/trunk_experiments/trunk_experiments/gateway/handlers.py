"""Requests to the gateway: for a file of the page, or for a page's WebSocket; all others are refused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tornado.web import HTTPError, RequestHandler
from tornado.websocket import WebSocketHandler

from .access import MOST_CLIENTS
from .clients import Client
from .protocol import NAME

if TYPE_CHECKING:
    from .server import Gateway

_FOR_CONTROL = 4  # places reserved for pages that may control
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


class _Checked(RequestHandler):
    """Answers a request only if it is addressed to our site."""

    gateway: Gateway

    def initialize(self, gateway: Gateway) -> None:
        self.gateway = gateway

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in _HEADERS.items():
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
        self.client = Client(self.gateway.next_name(), self, self.may == "control")
        self.client.greet()
        self.gateway.joined(self.client)

    def on_message(self, message: str | bytes) -> None:
        """Take a message from the page."""
        if self.client is not None:
            self.gateway.take(self.client, message)

    def on_close(self) -> None:
        """Forget the page."""
        if self.client is not None:
            self.gateway.left(self.client)
