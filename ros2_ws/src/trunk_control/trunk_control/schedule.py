"""When a controller is active: turns at given times of the states' stamps.

Several controllers whose turns fit together take over from one another at the same state, without a
word between them: the same in real time, in lock-step and in an offline run.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence


def active_at(times_ns: Sequence[int], stamp_ns: int) -> bool:
    """Return True where a controller is active: from the 1st time up to the 2nd, from the 3rd on, ...

    ``times_ns`` ascend; the state at a time belongs to the turn that begins. Empty: always active.
    """
    return not times_ns or bisect_right(times_ns, stamp_ns) % 2 == 1


def turn(times_ns: Sequence[int], before_ns: int, stamp_ns: int) -> bool | None:
    """Return what the schedule asks for between two states: True to activate, None for nothing."""
    if bisect_right(times_ns, before_ns) == bisect_right(times_ns, stamp_ns):
        return None
    return active_at(times_ns, stamp_ns)
