"""The endpoints of a run: publishers of what is recorded, and subscriptions to publishers of any reliability.

Messages are counted as they are published, and received by the recorder before their node ends. A
subscription is reliable until a best-effort publisher shows that it would not be heard.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence

from rclpy.duration import Duration
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_core.deadline import patience
from trunk_core.parameters.declarations import ParameterError

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


_OVERRIDES = (
    "reliability: reliable or best_effort; history: keep_last or keep_all; depth: an integer > 0"
)


class AdaptiveSubscription:
    """The loop's subscription to serialized JointState messages, from publishers of either reliability.

    DDS matches a reliable subscription with reliable publishers alone, and a best-effort one with all; but
    only a reliable one has lost messages sent again. So it asks for best effort
    once a publisher offers only that.

    Users may set depth, history and reliability themselves, by ROS's own parameters
    ``qos_overrides.TOPIC.subscription.…``.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        callback: Callable[[bytes], None],
        profile: QoSProfile | None = None,
    ) -> None:
        """``profile``: by default that of `qos.control`. Raises ParameterError for a wrong override."""
        self._node = node
        self._topic = topic
        self._callback = callback
        self._profile = profile or qos.control()
        self._subscription = self._subscribe(QoSOverridingOptions.with_default_policies())

    def _subscribe(self, overrides: QoSOverridingOptions | None) -> Subscription:
        try:
            return self._node.create_subscription(
                JointState,
                self._topic,
                self._callback,
                self._profile,
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._incompatible),
                qos_overriding_options=overrides,
            )
        except (RuntimeError, TypeError, ValueError, InvalidParameterTypeException) as error:
            # rclpy says which policy, but not of which topic.
            name = f"qos_overrides.{self._node.resolve_topic_name(self._topic)}.subscription"
            raise ParameterError(name, str(error), _OVERRIDES) from None

    @property
    def topic_name(self) -> str:
        """The topic's absolute name."""
        return str(self._subscription.topic_name)

    def get_publisher_count(self) -> int:
        """Return the number of matched publishers."""
        return int(self._subscription.get_publisher_count())

    def _incompatible(self, event: QoSRequestedIncompatibleQoSInfo) -> None:
        best_effort = self._profile.reliability == ReliabilityPolicy.BEST_EFFORT
        if event.last_policy_kind != QoSPolicyKind.RELIABILITY or best_effort:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self._node.get_logger().warning(
                f"a publisher of {self.topic_name} is not heard: its {policy} is incompatible with "
                "this node's"
            )
            return
        self._profile = QoSProfile(
            depth=self._profile.depth,
            reliability=ReliabilityPolicy.BEST_EFFORT,
            durability=self._profile.durability,
        )
        self._node.get_logger().info(
            f"a publisher of {self.topic_name} is best effort: heard, but a lost message is not sent again"
        )
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe(None)
