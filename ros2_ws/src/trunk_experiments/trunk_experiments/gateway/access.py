"""Who may talk to the gateway, and how much: tokens, hosts, origins, rates. Pure."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence
from hmac import compare_digest
from typing import NamedTuple

MOST_CLIENTS = 16


class Tokens(NamedTuple):
    """What the page's address ends with: one lets do everything, the other lets look."""

    control: str
    watch: str

    @classmethod
    def new(cls) -> Tokens:
        """Return two that nobody guesses: 256 bits each."""
        return cls(secrets.token_urlsafe(32), secrets.token_urlsafe(32))

    def may(self, offered: Sequence[str]) -> str:
        """Return ``control``, ``watch`` or nothing, by the tokens that are offered."""
        for name, token in zip(self._fields, self, strict=True):
            if any(compare_digest(one.encode(), token.encode()) for one in offered):
                return name
        return ""


class Hosts(NamedTuple):
    """By which names the gateway may be called: pages of other sites cannot make a browser use others."""

    names: frozenset[str]
    port: int

    def known(self, host: str) -> bool:
        """Return True for the ``Host`` of a request to us."""
        return host in self._called()

    def same(self, origin: str | None) -> bool:
        """Return True for the ``Origin`` of our page, and for who has none: browsers always do."""
        return origin is None or origin in {f"http://{name}" for name in self._called()}

    def _called(self) -> set[str]:
        # Of IPv6 addresses, URLs have brackets.
        called = {f"[{name}]" if ":" in name else name for name in self.names}
        return {f"{name}:{self.port}" for name in called}


class Rate:
    """How often something may happen: so often a second, and as much again at once."""

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
