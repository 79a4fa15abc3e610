"""Disturbances as they come in, told ahead of time, and what of them acts at a stamp. Pure."""

from __future__ import annotations

from collections import deque

from .disturbances import Disturbance

_QUIET = Disturbance()
# A disturbance may be told so long before it acts; one with a stamp beyond would keep out all others.
_AHEAD_NS = 1_000_000_000
_DEPTH = 5000


class DisturbanceFeed:
    """Keeps what is told until its time comes."""

    def __init__(self, period_ns: int) -> None:
        self._ahead_ns = max(period_ns, _AHEAD_NS)
        self._told: deque[tuple[int, Disturbance]] = deque(maxlen=_DEPTH)
        self._told_until_ns = -1
        self._since_ns = -1  # before the first one nothing disturbs
        self.acting = _QUIET

    def __bool__(self) -> bool:
        """Return True where something is told that has not acted yet."""
        return bool(self._told)

    def take(self, stamp_ns: int, disturbance: Disturbance, now_ns: int) -> bool:
        """Take in what acts from a stamp on; False where its stamp runs back or lies too far ahead."""
        if stamp_ns <= self._told_until_ns or stamp_ns - now_ns > self._ahead_ns:
            return False
        self._told_until_ns = stamp_ns
        self._told.append((stamp_ns, disturbance))
        return True

    def advance(self, now_ns: int, timeout_ns: int | None) -> bool:
        """Let ``acting`` be what acts at a stamp; return True where the last word of it is too old.

        Whoever pushed is gone then: a pulse must not go on for ever. No timeout: it never is.
        """
        while self._told and self._told[0][0] <= now_ns:
            self._since_ns, self.acting = self._told.popleft()
        stale = timeout_ns is not None and 0 <= self._since_ns < now_ns - timeout_ns
        if stale:
            self.acting = _QUIET
        return stale
