"""When a controller is active: turns at given times, compared with the states' stamps.

Several controllers whose turns fit together take over from one another at the same state without
exchanging messages: the same in real time, in lock-step and in an offline run.

Pure: functions of integers, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence


def turns_begun(times_ns: Sequence[int], stamp_ns: int) -> int:
    """Return how many of the ascending times are at or before a stamp."""
    count = 0
    for time_ns in times_ns:
        if time_ns <= stamp_ns:
            count += 1
    return count


def active_at(times_ns: Sequence[int], stamp_ns: int) -> bool:
    """Return True if a controller is active: from the 1st time to the 2nd, from the 3rd on, ...

    ``times_ns`` ascend; a state at one of the times belongs to the turn that begins there. Empty:
    always active.
    """
    return len(times_ns) == 0 or turns_begun(times_ns, stamp_ns) % 2 == 1


def turn(times_ns: Sequence[int], before_ns: int, stamp_ns: int) -> int:
    """Return what the schedule asks for between two states: 1 to activate, -1 to deactivate, 0 nothing."""
    if len(times_ns) == 0 or turns_begun(times_ns, before_ns) == turns_begun(times_ns, stamp_ns):
        return 0
    return 1 if active_at(times_ns, stamp_ns) else -1
