"""What a node waits for: reported when that changes, and then every few seconds. Pure."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from ..units import seconds

_AGAIN_S = 5.0
# A node that runs is met well within this time on a good link.
_UNMET_S = 10.0
# In a line that says how to start what is missing.
_START = "ros2 run "


class Waiting:
    """Says a line at once if it is a new one, and repeats it while it stays the same."""

    def __init__(self) -> None:
        self._said = ""
        self._said_at = self._since = 0.0

    def line(self, text: str, now: float, settings: Mapping[str, str] = os.environ) -> str:
        """Return the line to say now, empty for none; ``text``: what for, empty for nothing. ``now`` in s.

        ``settings`` of discovery are named where somebody who may well be running was not met for long.
        """
        if not text or (text == self._said and now - self._said_at < _AGAIN_S):
            self._said = text and self._said
            return ""
        if text != self._said:
            self._since = now
        self._said, self._said_at = text, now
        unmet = _START in text and now - self._since >= _UNMET_S
        return f"waiting for {text}{f'; {not_met(settings)}' if unmet else ''}"


def not_met(settings: Mapping[str, str]) -> str:
    """Return what to look at where a node runs and is not met, by the settings of this one."""
    if server := settings.get("ROS_DISCOVERY_SERVER"):
        return (
            f"if it runs, it was not met: ROS_DISCOVERY_SERVER must be {server} there too, the server must "
            "run, and UDP must pass both ways (docs/hosts.md)"
        )
    domain = settings.get("ROS_DOMAIN_ID", "0")
    if settings.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST":
        return (
            f"if it runs, it was not met: ROS_DOMAIN_ID must be {domain} there too; on another machine, set "
            "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET on both (docs/hosts.md)"
        )
    return (
        f"if it runs, it was not met: ROS_DOMAIN_ID must be {domain} there too, and multicast must pass; "
        "where it does not, run a discovery server (docs/hosts.md)"
    )


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
