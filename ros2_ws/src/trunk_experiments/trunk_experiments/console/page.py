"""What verbs share that show a page: where it is served, and opening it."""

from __future__ import annotations

import ipaddress
import os
import sys
import time
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import click

from trunk_msgs_util.node.early_signals import Interrupt

from ..errors import PlanError
from ..gateway.access import origin_of
from ..gateway.process import LOOPBACK, GatewayProcess
from ..results import Result
from .document import write_json
from .options import WholeRange

_LOOK_S = 0.05


def page_options(function: Any) -> Any:
    """Add ``--host``, ``--port`` and ``--url``."""
    for option in (
        click.option(
            "--url",
            default="",
            metavar="URL",
            callback=lambda context, option, url: _checked_url(url),
            help="What browsers open, such as http://127.0.0.1:8080, where a container's port, a tunnel or "
            "a proxy leads to the page; any other address is refused.  [default: host and port]",
        ),
        click.option(
            "--port",
            type=WholeRange(0, 65535),
            default=0,
            help="Port of the page.  [default: a free one]",
        ),
        click.option(
            "--host",
            default=LOOPBACK,
            show_default=True,
            metavar="ADDRESS",
            help="Address of this machine for the page; any but the default is open to other machines.",
        ),
    ):
        function = option(function)
    return function


@dataclass(frozen=True)
class PageResult(Result, document="page-1"):
    """The document of ``trunk live``."""

    address: Annotated[str, "Of the page, to control the run"]
    watch_address: Annotated[str, "Of the page, to watch only"]
    recording: Annotated[Path | None, "Written; null for a graph that was joined"]


def checked_host(host: str, url: str) -> str:
    """Return the address to serve on.

    Raises PlanError for a name, and for all addresses at once where no ``url`` says what browsers open.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        address = None
    if address is None or (address.is_unspecified and not url):
        raise PlanError(
            f"--host {host}: give one address of this machine, at which browsers will reach it, such as "
            f"{LOOPBACK}; all of them, 0.0.0.0, need --url, the address that browsers open"
        )
    return str(address)


def _checked_url(url: str) -> str:
    try:
        return origin_of(url) if url else ""
    except ValueError as error:
        raise PlanError(f"--url {url}: {error}") from None


def show_address(
    gateway: GatewayProcess, browser: bool, recording: Path | None, as_json: bool = False
) -> None:
    """Print the page's addresses, and open the first one in a browser, where there is one."""
    watch = gateway.address(gateway.tokens.watch)
    address = gateway.address(gateway.tokens.control)
    if as_json:
        write_json(PageResult(address, watch, recording))
    click.echo(f"page: {address}")
    click.echo(f"to watch only: {watch}")
    if browser:
        open_page(address)


def open_page(address: str) -> bool:
    """Open a page in a browser; False without a screen: a text browser would take over the terminal."""
    screen = (
        sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    return bool(screen) and webbrowser.open(address)


def serve(
    gateway: GatewayProcess,
    interrupt: Interrupt,
    over: Callable[[str], bool] = lambda word: False,
) -> None:
    """Keep the gateway up until it is interrupted, or until a word from it is ``over``."""
    while not interrupt.name:
        if any(over(word) for word in gateway.words()):
            return
        time.sleep(_LOOK_S)
