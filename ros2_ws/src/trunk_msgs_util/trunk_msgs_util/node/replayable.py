"""Publishers of what is recorded of a run: counted, and received by the recorder before their node ends."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState

from .. import topics
from ..deadline import patience
from . import discovery, qos

# A node that ends waits at most this long for the recorder and every other reliable reader to receive
# what it published; this and the next limit are multiplied by TRUNK_PATIENCE.
_ACKNOWLEDGED_S = 3.0
# A node discovers a recorder within this time after its start, and after its first message to be recorded
# (the plant may have waited for the recorder). After that, a node that knows of no recorder ends at once.
_DISCOVERED_S = 2.0
_LOOK_S = 0.01


class ReplayablePublisher:
    """Publishes serialized messages twice, and counts them: live for the loop, and kept for the recorder.

    The live topic has only the present; `topics.evidence` names the topic that also has the past. What the
    loop does not need goes to the recorder alone.
    """

    def __init__(self, node: Node, topic: str, live: bool = True) -> None:
        self._node = node
        self.topic = node.resolve_topic_name(topic)
        # A recorder hears these from its beginning; it looks for others.
        self.named = topic in topics.evidence_types((), topics.REAL_TIME)
        # DDS announces them in this order: a recorder finds the live one last, and knows that it is ours.
        self._kept = node.create_publisher(JointState, topics.evidence(self.topic), qos.evidence())
        # Bypasses rclpy's check of the message's type, a third of the cost of publishing.
        self._publish_live: Callable[[bytes], None] | None = None
        if live:
            self._live = node.create_publisher(JointState, topic, qos.live())
            self._publish_live = self._live.handle.publish_raw
        self._publish_kept = self._kept.handle.publish_raw
        self.count = 0
        self.began_s = -math.inf  # monotonic clock, of the first message

    def publish(self, data: bytes) -> None:
        """Publish a serialized message: first to the loop, which waits for it."""
        if self._publish_live is not None:
            self._publish_live(data)
        self._publish_kept(data)
        self.count += 1
        if self.count == 1:
            self.began_s = time.monotonic()

    def recorders(self) -> set[str]:
        """Return the nodes that subscribe to it; one whose name is not known yet has discovery's."""
        return set(discovery.names(discovery.recorders(self._node, self.topic)))


def counted(publishers: Sequence[ReplayablePublisher]) -> dict[str, int]:
    """Return how many messages were published, by topic; topics without any are left out."""
    counts: Counter[str] = Counter()
    for publisher in publishers:
        counts[publisher.topic] += publisher.count
    return dict(+counts)


def await_acknowledgement(
    node: Node, born_s: float, publishers: Sequence[ReplayablePublisher]
) -> None:
    """Wait, for a bounded time, until every reliable reader has received what the node published.

    If one of ``publishers`` has published, first wait until every known recorder is matched with this
    node, on the topics that it looks for as well. If none is known, one may still be discovered for some
    time after the node's start, ``born_s`` (monotonic clock), and after its first message to be recorded:
    wait for it until then.
    """
    published = [publisher for publisher in publishers if publisher.count]
    known_s = max([born_s, *(publisher.began_s for publisher in published)])
    known_s += _DISCOVERED_S * patience()
    deadline = time.monotonic() + _ACKNOWLEDGED_S * patience()
    while published and time.monotonic() < deadline:
        heard = [(publisher.named, publisher.recorders()) for publisher in published]
        recorders = set().union(*(nodes for _, nodes in heard))
        # Others than recorders hear some of it only.
        of_all = recorders.intersection(*(nodes for named, nodes in heard if named))
        sought = all(of_all <= nodes for _, nodes in heard)
        # DDS announces a participant's subscriptions in the order of their creation; of those for named
        # topics, the recorder creates the one for the run's parameters last.
        late = time.monotonic() > known_s  # through a discovery server they may not find all
        met = bool(recorders) and recorders <= discovery.listeners(node, topics.RUN_PARAMETERS)
        if (met and (sought or late)) or (late and not recorders):
            break
        time.sleep(_LOOK_S)
    for publisher in list(node.publishers):
        left = max(deadline - time.monotonic(), 0.0)
        publisher.wait_for_all_acked(Duration(seconds=left))
