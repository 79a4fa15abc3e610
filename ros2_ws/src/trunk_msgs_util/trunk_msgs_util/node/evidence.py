"""Evidence of a run: counted where it is published, and in the recorder's hands before its node ends."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher

from .. import topics
from . import meeting

# So long a node that ends waits at most until a recorder that is there, and every other reliable reader,
# has what was published.
_HAND_OVER_S = 3.0
# A recorder is found within this time of a node's beginning; without one, a node that is older ends at once.
_FOUND_S = 2.0
_LOOK_S = 0.01


class Evidence:
    """A publisher of serialized messages that counts them."""

    def __init__(self, publisher: Publisher) -> None:
        self.publisher = publisher
        self.count = 0

    def publish(self, data: bytes) -> None:
        """Publish a serialized message."""
        self.publisher.publish(data)
        self.count += 1


def counted(evidence: Sequence[Evidence]) -> dict[str, int]:
    """Return how many messages were published, by topic; topics without any are left out."""
    counts: Counter[str] = Counter()
    for one in evidence:
        counts[one.publisher.topic_name] += one.count
    return dict(+counts)


def claims(values: Mapping[str, str]) -> dict[str, int]:
    """Return the counts that an event tells. Raises ValueError where one is no whole number."""
    return {topic: int(count) for topic, count in values.items()}


def hand_over(node: Node, born_s: float, anything: bool) -> None:
    """Wait, within a bound, until every reliable reader has what the node has published.

    Where there is ``anything`` to record, a recorder that this node knows has to have found it first; one
    that is not known may still be on its way to a node that was ``born_s`` (monotonic clock) ago.
    """
    deadline = time.monotonic() + _HAND_OVER_S
    while anything and not _recorder_met(node) and time.monotonic() < deadline:
        if time.monotonic() > born_s + _FOUND_S and not node.get_publishers_info_by_topic(
            topics.RECORDER_PROGRESS
        ):
            break
        time.sleep(_LOOK_S)
    for publisher in list(node.publishers):
        left = max(deadline - time.monotonic(), 0.0)
        publisher.wait_for_all_acked(Duration(seconds=left))


def _recorder_met(node: Node) -> bool:
    """Return True once each recorder that is known has been met with all its subscriptions.

    DDS tells a reader's subscriptions in the order in which they were made: the recorder's last is that
    of the run's events.
    """
    recorders = meeting.names(node.get_publishers_info_by_topic(topics.RECORDER_PROGRESS))
    return bool(recorders) and set(recorders) <= meeting.listeners(node, topics.RUN_EVENTS)
