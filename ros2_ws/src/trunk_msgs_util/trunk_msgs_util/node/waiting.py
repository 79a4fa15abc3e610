"""What a node waits for: reported when that changes, and then every few seconds. Pure."""

from __future__ import annotations

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


def states(topic: str, published: bool, last_ns: int | None) -> str:
    """Return what a node that hears no states waits for; empty if their publisher is only holding them.

    ``last_ns``: the stamp of the last one, None if there was none yet; ``published``: there is a publisher.
    """
    if last_ns is not None:
        last = f"the last one was at t = {seconds(last_ns):g} s"
        return "" if published else f"states on {topic}: {last}, and nobody publishes them now"
    if published:
        return f"the first state on {topic}: its publisher has not started yet"
    return f"states on {topic}: nobody publishes them (start it: ros2 run trunk_sim simulator)"
