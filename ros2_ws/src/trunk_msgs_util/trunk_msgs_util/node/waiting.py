"""What a node waits for: reported when that changes, and then every few seconds. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..units import seconds

_AGAIN_S = 5.0


class Waiting:
    """Says a line at once if it is a new one, and repeats it while it stays the same."""

    def __init__(self) -> None:
        self._said = ""
        self._said_at = 0.0

    def line(self, text: str, now: float) -> str:
        """Return the line to say now, empty for none; ``text``: what for, empty for nothing. ``now`` in s."""
        if not text or (text == self._said and now - self._said_at < _AGAIN_S):
            self._said = text and self._said
            return ""
        self._said, self._said_at = text, now
        return f"waiting for {text}"


def states(
    topic: str, publishers: Sequence[str], last_ns: int | None, refused: Mapping[str, int]
) -> str:
    """Return what a node that hears no states waits for; empty if their publisher is only holding them.

    ``last_ns``: the stamp of the last one, None if there was none yet; ``publishers``: who publishes them;
    ``refused``: how many states were not used, by reason.
    """
    if last_ns is not None:
        last = f"the last one was at t = {seconds(last_ns):g} s"
        return "" if publishers else f"states on {topic}: {last}, and nobody publishes them now"
    if refused:
        counts = ", ".join(f"{reason} {count}" for reason, count in refused.items())
        return f"the first usable state on {topic}: {counts}"
    if publishers:
        return f"the first state on {topic}: none has come from {', '.join(publishers)} yet"
    return f"states on {topic}: nobody publishes them (start it: ros2 run trunk_sim simulator)"
