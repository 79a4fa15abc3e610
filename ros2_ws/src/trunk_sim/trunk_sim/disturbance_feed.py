"""Queues disturbances, which arrive ahead of time, and gives the one in force at a stamp. Pure."""

from __future__ import annotations

from collections import deque

from trunk_msgs_util.units import seconds

from .acting import UNDISTURBED, Disturbed
from .answers import RefusedError
from .disturbances import Disturbance

# How far ahead a disturbance may arrive; one stamped later than this would block all that follow.
_AHEAD_NS = 1_000_000_000
_DEPTH = 5000


class DisturbanceFeed:
    """Keeps each disturbance until its time comes."""

    def __init__(self, period_ns: int) -> None:
        self._ahead_ns = max(period_ns, _AHEAD_NS)
        self._told: deque[Disturbed] = deque(maxlen=_DEPTH)
        self._told_until_ns = -1
        self._latest = UNDISTURBED
        self.in_force = UNDISTURBED

    def __bool__(self) -> bool:
        """Return True while a disturbance is waiting for its time."""
        return bool(self._told)

    @property
    def acting(self) -> Disturbance:
        """What acts."""
        return self.in_force.disturbance

    def take(self, stamp_ns: int, disturbance: Disturbance, now_ns: int, source: str = "") -> None:
        """Queue what acts from a stamp on. Raises RefusedError for one out of order or too far ahead."""
        if stamp_ns <= self._told_until_ns:
            raise RefusedError(
                "disturbances out of order",
                f"t = {seconds(stamp_ns):g} s comes after t = {seconds(self._told_until_ns):g} s: "
                "stamps must ascend",
            )
        if stamp_ns - now_ns > self._ahead_ns:
            raise RefusedError(
                f"disturbances more than {seconds(self._ahead_ns):g} s ahead",
                f"t = {seconds(stamp_ns):.9g} s, while the state is at t = {seconds(now_ns):g} s: "
                "stamp them in simulated time",
            )
        self._told_until_ns = stamp_ns
        self._told.append(Disturbed(stamp_ns, disturbance, source))

    def advance(self, now_ns: int, timeout_ns: int | None) -> bool:
        """Set ``in_force`` to what acts at a stamp; return True if the latest disturbance is too old.

        Its sender is then taken as gone; a pulse must not last forever. Without a timeout nothing is too old.
        """
        while self._told and self._told[0].stamp_ns <= now_ns:
            self._latest = self._told.popleft()
        stale = timeout_ns is not None and 0 <= self._latest.stamp_ns < now_ns - timeout_ns
        self.in_force = UNDISTURBED if stale else self._latest
        return stale
