"""Which nodes are matched in both directions, and what a waiting node says.

DDS discovers each direction separately, and a volatile subscription misses whatever is published before its
publisher has discovered it. So a node that answers states reports that it is ready once the publisher of the
states subscribes to its answers, and that publisher starts once it has discovered the node as a subscriber.

Through a discovery server a node learns only of topics on which it has an endpoint itself, and only of the
endpoints at the other end: who subscribes to what it publishes, and who publishes what it subscribes to.
Nothing else is asked for here.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from trunk_core import topics
from trunk_core.topics import UNKNOWN_NODE
from trunk_core.units import seconds

# Of an endpoint's GUID, the bytes that name its DDS participant.
_PARTICIPANT = slice(12)


def names(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the full name of the node behind each endpoint."""
    return [f"{e.node_namespace.rstrip('/')}/{e.node_name}" for e in endpoints]


def known(endpoints: Iterable[TopicEndpointInfo]) -> set[str]:
    """Return the nodes whose names are known."""
    return {name for name in names(endpoints) if not name.endswith(UNKNOWN_NODE)}


def publishers(node: Node, topic: str) -> set[str]:
    """Return the nodes that are known to publish on a topic."""
    return known(node.get_publishers_info_by_topic(topic))


def described_publishers(node: Node, topic: str) -> list[str]:
    """Return who publishes on a topic, and whether a lost message is not sent again."""
    endpoints = node.get_publishers_info_by_topic(topic)
    return [
        f"{name} (best effort)"
        if endpoint.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        else name
        for name, endpoint in zip(names(endpoints), endpoints, strict=True)
    ]


def listeners(node: Node, topic: str) -> set[str]:
    """Return the nodes that are known to subscribe to a topic."""
    return known(node.get_subscriptions_info_by_topic(topic))


def recorders(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return the subscriptions to the evidence that this node publishes on a topic, fully qualified.

    Only a recorder subscribes to it.
    """
    return node.get_subscriptions_info_by_topic(topics.evidence(topic))


def reporting(node: Node, endpoints: Sequence[TopicEndpointInfo]) -> set[str]:
    """Return the nodes behind endpoints that publish events of the run, too: nodes of this project.

    ``node`` must subscribe to these events.

    One whose name is not known yet is returned as such, if its process publishes events.
    """
    reports = node.get_publishers_info_by_topic(topics.RUN_EVENTS)
    named = known(reports)
    theirs = _participants(reports)
    return {
        name
        for name, endpoint in zip(names(endpoints), endpoints, strict=True)
        if name in named or (name.endswith(UNKNOWN_NODE) and _participants([endpoint]) <= theirs)
    }


def share_a_participant(
    endpoints: Iterable[TopicEndpointInfo], others: Iterable[TopicEndpointInfo]
) -> bool:
    """Return True if a DDS participant has one of each; its node need not have a name yet."""
    return bool(_participants(endpoints) & _participants(others))


def _participants(endpoints: Iterable[TopicEndpointInfo]) -> set[bytes]:
    return {bytes(endpoint.endpoint_gid[_PARTICIPANT]) for endpoint in endpoints}


def matched(node: Node, hears: str, answers: str) -> bool:
    """Return True if a publisher of ``hears`` is known that also subscribes to ``answers``."""
    return bool(publishers(node, hears) & listeners(node, answers))


_AGAIN_S = 5.0
# A node that runs is met well within this time on a good link.
_UNMET_S = 10.0


class Wait(NamedTuple):
    """What a node waits for, in words; nothing if ``what`` is empty."""

    what: str = ""
    seen_instead: str = ""  # what may be meant for it, and does not fit
    unmet: bool = False  # it is a node that was not met: it may well be running

    def __str__(self) -> str:
        return f"{self.what}; seen instead: {self.seen_instead}" if self.seen_instead else self.what


class Waiting:
    """Says a line at once if it is a new one, and repeats it while it stays the same."""

    def __init__(self) -> None:
        self._said = ""
        self._said_at = self._since = 0.0

    def line(self, wait: Wait, now: float, settings: Mapping[str, str] = os.environ) -> str:
        """Return the line to say now, empty for none; ``now`` in s.

        ``settings`` of discovery are named where a node was not met for long.
        """
        text = str(wait)
        if not text or (text == self._said and now - self._said_at < _AGAIN_S):
            self._said = text and self._said
            return ""
        if text != self._said:
            self._since = now
        self._said, self._said_at = text, now
        unmet = wait.unmet and now - self._since >= _UNMET_S
        return f"waiting for {text}{f'; {not_discovered(settings)}' if unmet else ''}"


def not_discovered(settings: Mapping[str, str]) -> str:
    """Return advice for a node that runs and is not discovered, by the settings of this one."""
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
) -> Wait:
    """Return the wait of a node that hears no states; nothing if their publisher is only holding them.

    ``last_ns``: the stamp of the last one, None if there was none yet; ``publishers``: who publishes them;
    ``refused``: how many states were not used, by reason.
    """
    if last_ns is not None:
        last = f"the last one was at t = {seconds(last_ns):g} s"
        gone = f"states on {topic}: {last}, and nobody publishes them now"
        return Wait() if publishers else Wait(gone)
    if refused:
        counts = ", ".join(f"{reason} {count}" for reason, count in refused.items())
        return Wait(f"the first usable state on {topic}: {counts}")
    if publishers:
        return Wait(f"the first state on {topic}: none has come from {', '.join(publishers)} yet")
    start = f"states on {topic}: nobody publishes them (start it: ros2 run trunk_sim simulator)"
    return Wait(start, unmet=True)
