"""Time as integer nanoseconds, so that step k is stamped k times the period and nothing drifts."""

from __future__ import annotations

NANOSECONDS = 1_000_000_000
LAST_STAMP_NS = 2**31 * NANOSECONDS - 1  # the largest that a ROS message can carry


def nanoseconds(seconds: float) -> int:
    """Return a time in s as integer nanoseconds, to the nearest."""
    return round(seconds * NANOSECONDS)


def seconds(stamp_ns: int) -> float:
    """Return a stamp in ns as s, correctly rounded (by division: 1e-9 is not a double)."""
    return stamp_ns / NANOSECONDS


def period_ns(rate: float) -> int:
    """Return the period of a rate in Hz as integer nanoseconds, to the nearest.

    Every duration in the project is a multiple of it, so 60 Hz runs at 1e9 / 16666667 Hz, exactly.
    """
    return round(NANOSECONDS / rate)


def step_count(duration: float, rate: float) -> int:
    """Return the number of steps nearest to ``duration`` s at ``rate`` Hz."""
    return round(nanoseconds(duration) / period_ns(rate))
