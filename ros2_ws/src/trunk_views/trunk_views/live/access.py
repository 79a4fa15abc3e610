"""Who may talk to the gateway, and how much: tokens, hosts, origins, headers, rates. Pure."""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Sequence
from hmac import compare_digest
from ipaddress import IPv6Address
from typing import NamedTuple
from urllib.parse import urlsplit

MOST_CLIENTS = 16
HEADERS = {
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
_PORTS = {"http": 80, "https": 443}


class Tokens(NamedTuple):
    """The end of the page's address: one token allows everything, the other only watching."""

    control: str
    watch: str

    @classmethod
    def new(cls) -> Tokens:
        """Return two that cannot be guessed: 256 bits each."""
        return cls(secrets.token_urlsafe(32), secrets.token_urlsafe(32))

    def may(self, offered: Sequence[str]) -> str:
        """Return ``control``, ``watch`` or an empty text, by the tokens that are offered."""
        for name, token in zip(self._fields, self, strict=True):
            if any(compare_digest(candidate.encode(), token.encode()) for candidate in offered):
                return name
        return ""


class Site(NamedTuple):
    """The page's origins: a page of another site cannot make a browser send a request that names one."""

    origins: frozenset[str]

    @classmethod
    def at(cls, url: str) -> Site:
        """Return the site with this address; on this machine's 127.0.0.1 it is ``localhost`` as well.

        Raises ValueError as `origin_of` does.
        """
        origin = origin_of(url)
        alias = re.sub(r"//127\.0\.0\.1(?=:|$)", "//localhost", origin)
        return cls(frozenset({origin, alias}))

    def known(self, host: str) -> bool:
        """Return True for the ``Host`` of a request to us."""
        return host in {origin.partition("//")[2] for origin in self.origins}

    def same(self, origin: str | None) -> bool:
        """Return True for the ``Origin`` of our page, and for clients without one: browsers send it."""
        return origin is None or origin in self.origins


def origin_of(url: str) -> str:
    """Return a URL's origin as browsers send it: in lower case, without its scheme's own port.

    Raises ValueError, with what is allowed, for all that is not ``http://HOST:PORT`` or ``https://HOST:PORT``.
    """
    allowed = "http://HOST:PORT or https://HOST:PORT is allowed, without a path"
    try:
        parts = urlsplit(url)
        given, port = parts.hostname or "", parts.port
        host = given
        if ":" in given:  # brackets around IPv6 addresses
            given, host = f"[{given}]", f"[{IPv6Address(given)}]"
    except ValueError as error:
        raise ValueError(f"{error}; {allowed}") from None
    name = re.fullmatch(r"[a-z0-9._-]+|\[[0-9a-f:.]+\]", host)
    whole = {
        f"{parts.scheme}://{given}{port}{end}" for port in ("", f":{port}") for end in ("", "/")
    }
    if parts.scheme not in _PORTS or not name or url.lower() not in whole:
        raise ValueError(allowed)
    shown = "" if port in (None, _PORTS[parts.scheme]) else f":{port}"
    return f"{parts.scheme}://{host}{shown}"


class Rate:
    """A limit on how often something may happen in a second; one second's worth may come at once."""

    def __init__(self, a_second: float, clock: Callable[[], float]) -> None:
        self._a_second, self._clock = a_second, clock
        self._left, self._then = a_second, clock()

    def allows(self) -> bool:
        """Return True if it may happen now, and count it."""
        now = self._clock()
        self._left = min(self._a_second, self._left + (now - self._then) * self._a_second)
        self._then = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
