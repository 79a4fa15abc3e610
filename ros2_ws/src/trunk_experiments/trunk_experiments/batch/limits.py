"""How long a compiled run may be, since all its states are held in memory."""

from __future__ import annotations

from trunk_msgs_util.units import step_count

MAX_STATES = 20_000_000  # 1.8 GB


def wrong_duration(duration: float, rate: float) -> str:
    """Return the fault in a run of ``duration`` s at ``rate`` Hz; empty if there is none."""
    if duration == 0.0:
        return "duration is 0 s: a compiled run needs an end"
    states = step_count(duration, rate) + 1
    if states <= MAX_STATES:
        return ""
    return (
        f"{states} states in a run: at most {MAX_STATES} are allowed; shorten it, or lower the rate"
    )
