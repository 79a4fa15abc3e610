"""``trunk report``: runs as one HTML page, written, opened and served."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from hmac import compare_digest
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Annotated

import click

from ..console.document import json_option, write_json
from ..console.options import exclude
from ..console.outputs import OutputResult, check_output, default_name, output_options
from ..console.page import checked_host, open_page, page_options
from ..console.reading import open_views, show_warnings_of
from ..console.terminal import show_warnings
from ..gateway.access import HEADERS, Site
from ..gateway.process import listening, url_of
from ..replay.doubts import RecordingResult, about
from ..results import Count, Keyword


@dataclass(frozen=True)
class ReportResult(OutputResult, document="report-1"):
    """The document of ``trunk report``."""

    bytes: Count
    address: Annotated[str | None, "Of the page, with --serve"]
    runs: Annotated[Sequence[RecordingResult], Keyword("minItems", 1)]


@click.command("report")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@output_options("The page to write.  [default: RUN.html, named after the run's folder]")
@click.option(
    "--open", "opens", is_flag=True, help="Open the page in a browser, where there is one."
)
@click.option(
    "--serve", is_flag=True, help="Serve the page, by a path that is secret, until Ctrl-C."
)
@page_options
@json_option(ReportResult)
def command(
    runs: tuple[Path, ...],
    output: Path | None,
    force: bool,
    opens: bool,
    serve: bool,
    host: str,
    port: int,
    url: str,
    as_json: bool,
) -> None:
    """Write one HTML file that shows recorded runs: animated, plotted, judged.

    It needs no network and no server; several runs are shown side by side on the same clock.
    """
    from ..views.report import make_report, write

    if not serve:
        exclude("without --serve nothing is served", "host", "port", "url")
    target = check_output(output or default_name(runs[0], ".html"), (".html", ".htm"), force, runs)
    listener = listening(checked_host(host, url), port) if serve else None
    views = open_views(runs)
    show_warnings_of(views)
    size = write(make_report(views), target)
    served = Served(target, listener, url) if listener else None
    address = served.address if served else None
    if as_json:
        write_json(ReportResult(target, size, address, [about(view.run) for view in views]))
    else:
        click.echo(
            f"{target}: {len(views)} run{'s' if len(views) > 1 else ''}, {size / 1e6:.1f} MB"
        )
    if served:
        click.echo(f"page: {address}\nuntil Ctrl-C")
    page = address or target.absolute().as_uri()
    if opens and not open_page(page):
        show_warnings([f"--open: there is no browser here: open {page}"])
    if served:
        served.serve_forever()


class Served(ThreadingHTTPServer):
    """A page and nothing else, by a path that only its address has."""

    daemon_threads = True

    def __init__(self, page: Path, listener: socket.socket, url: str) -> None:
        """``url``: what browsers open; empty: the listener's."""
        super().__init__(listener.getsockname()[:2], Request, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self.page = page.read_bytes()
        self.path = f"/report-{secrets.token_urlsafe(32)}.html"
        self.site = Site.at(url or url_of(listener))
        self.address = (url or url_of(listener)).rstrip("/") + self.path

    def handle_error(self, *_: object) -> None:
        """Say nothing: the browser has closed the connection."""


class Request(BaseHTTPRequestHandler):
    """A request for the page."""

    server: Served
    server_version, sys_version = "trunk", ""
    timeout = 5.0  # s, for a request to come

    def do_GET(self) -> None:
        """Answer with the page, if the request is for it and addressed to its site."""
        if not self.server.site.known(self.headers.get("Host", "")):
            self.send_error(403)
        elif not compare_digest(self.path.encode(), self.server.path.encode()):
            self.send_error(404)
        else:
            self.send_response(200)
            # It brings the rest of its policy itself.
            policy = {"Content-Security-Policy": "frame-ancestors 'none'"}
            for name, value in (HEADERS | policy).items():
                self.send_header(name, value)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(self.server.page)))
            self.end_headers()
            self.wfile.write(self.server.page)

    def log_message(self, *_: object) -> None:
        """Say nothing: addresses are private."""
