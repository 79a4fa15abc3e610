"""Who may talk to the gateway, and how much: tokens, hosts, origins, rates. Pure."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence
from hmac import compare_digest
from typing import NamedTuple

MOST_CLIENTS = 16


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
            if any(compare_digest(one.encode(), token.encode()) for one in offered):
                return name
        return ""


class Hosts(NamedTuple):
    """The host names that requests may use: a page of another site cannot make a browser send them."""

    names: frozenset[str]
    port: int

    def known(self, host: str) -> bool:
        """Return True for the ``Host`` of a request to us."""
        return host in self._called()

    def same(self, origin: str | None) -> bool:
        """Return True for the ``Origin`` of our page, and for clients without one: browsers send it."""
        return origin is None or origin in {f"http://{name}" for name in self._called()}

    def _called(self) -> set[str]:
        # URLs have brackets around IPv6 addresses.
        called = {f"[{name}]" if ":" in name else name for name in self.names}
        return {f"{name}:{self.port}" for name in called}


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
