"""`RecordedSubscription`: each message of a topic once, from any publisher, whatever its quality of service.

DDS matches a subscription only with publishers that offer at least what it requests. Our nodes keep what
they publish for a recorder that joins late, on a separate topic (`topics.evidence`). Others publish only on
the live topic: rclpy and `ros2 topic pub` are volatile by default, and a sensor is often best effort. No
single subscription serves all of them: one that requests past messages does not match volatile publishers,
one that does not misses the past. So there is one more for each kind that some other publisher offers, just
as rosbag2 adapts to what is offered. A message that several subscriptions receive has the same time and
number in each, and is taken once.

Such a subscription also hears our nodes' live copies. They have the number and the bytes of the kept ones; in
real time they also name their source, and one whose messages are kept is not heard there.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeAlias

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from .. import topics
from ..recording.joint_state_cdr import frame_in
from ..source import source_in
from . import discovery, qos

Info: TypeAlias = Mapping[str, Any]  # what the middleware reports about a message
Kind: TypeAlias = tuple[ReliabilityPolicy, DurabilityPolicy]

# Twice what a publisher of evidence keeps: one that is matched late delivers all of it at once.
_REMEMBERED = 2 * qos.EVIDENCE_DEPTH
# A publisher whose node is still unknown after this many looks counts as somebody else's.
_UNNAMED_LOOKS = 20


class _Remembered:
    """Counts messages whose other copy is still to come, the newest ones."""

    def __init__(self) -> None:
        self._counts: OrderedDict[Hashable, int] = OrderedDict()

    def add(self, key: Hashable) -> None:
        """Note one more."""
        self._counts[key] = self._counts.get(key, 0) + 1
        if len(self._counts) > _REMEMBERED:
            self._counts.popitem(last=False)

    def take(self, key: Hashable) -> bool:
        """Return True if there is one, which is then done."""
        count = self._counts.pop(key, 0)
        if count > 1:
            self._counts[key] = count - 1
        return count > 0

    def __contains__(self, key: Hashable) -> bool:
        return key in self._counts


class RecordedSubscription:
    """The subscriptions to one topic; ``other_types`` has the nodes that publish something else there."""

    def __init__(
        self,
        node: Node,
        topic: str,
        type_name: str,
        message_type: Any,
        take: Callable[[bytes], None],
    ) -> None:
        """Subscribe; ``take`` gets each message."""
        self._node = node
        self._topic = topic
        self._type_name = type_name
        self._message_type = message_type
        self._take = take
        self.other_types: dict[str, str] = {}
        self._sources: set[str] = set()  # of messages that are kept
        self._passed: OrderedDict[Hashable, None] = OrderedDict()
        # Our nodes publish each message twice: here are those taken once, whose other copy is still to come.
        self._kept_alone = _Remembered()
        self._live_alone = _Remembered()
        self._passing: dict[Kind, Subscription] = {}
        self._looked_at = (0, 0)
        self._unnamed_looks = 0
        self._kept_topic = topics.evidence(node.resolve_topic_name(topic))
        self._kept = self._subscribe(self._kept_topic, qos.evidence(), self._on_kept)

    def _subscribe(
        self, topic: str, profile: QoSProfile, on_message: Callable[..., None]
    ) -> Subscription:
        return self._node.create_subscription(
            self._message_type,
            topic,
            on_message,
            profile,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=lambda _: self.look()),
        )

    @property
    def publisher_count(self) -> int:
        """The number of matched publishers of the subscription that has most."""
        subscriptions = (self._kept, *self._passing.values())
        return max(subscription.get_publisher_count() for subscription in subscriptions)

    @property
    def by_strangers(self) -> bool:
        """True if nodes that keep no evidence publish there, too."""
        return bool(self._passing)

    def look(self) -> None:
        """Subscribe once more for a publisher that no subscription receives; cheap if none is new."""
        counts = (self._node.count_publishers(self._topic), self._kept.get_publisher_count())
        if counts == self._looked_at:
            return
        self._looked_at = counts
        keep = discovery.publishers(self._node, self._kept_topic)
        for endpoint in self._node.get_publishers_info_by_topic(self._topic):
            name = discovery.names([endpoint])[0]
            if name in keep:
                continue
            if name.endswith(topics.UNKNOWN_NODE) and self._unnamed_looks < _UNNAMED_LOOKS:
                self._unnamed_looks += 1
                self._looked_at = (-1, -1)  # look again
            elif endpoint.topic_type != self._type_name:
                self._note_type(name, endpoint.topic_type)
            else:
                self._hear_passing(_kind(endpoint))

    def _note_type(self, node: str, type_name: str) -> None:
        if node not in self.other_types:
            self.other_types[node] = type_name
            self._node.get_logger().warning(f"nobody receives it: {self.of_other_types()[-1]}")

    def _hear_passing(self, kind: Kind) -> None:
        if kind in self._passing:
            return

        def on_message(data: bytes, info: Info) -> None:
            self._on_passing(data, info, kind)

        profile = QoSProfile(depth=qos.EVIDENCE_DEPTH, reliability=kind[0], durability=kind[1])
        self._passing[kind] = self._subscribe(self._topic, profile, on_message)

    def _on_kept(self, data: bytes, info: Info) -> None:
        """Take a message of a node of ours, unless its live copy was taken."""
        if self._passing:
            source = source_in(frame_in(data))
            if source:
                self._sources.add(source)
            key = info["publication_sequence_number"], data
            if self._live_alone.take(key):
                return
            if not source:
                self._kept_alone.add(key)
        self._take(data)

    def _on_passing(self, data: bytes, info: Info, kind: Kind) -> None:
        """Take a message of any publisher that offers as much as this subscription requests.

        A message has the same source time in every subscription that hears it.
        """
        source = source_in(frame_in(data))
        if source in self._sources:
            return
        number = info["publication_sequence_number"]
        sample = info["source_timestamp"], number, data
        if sample in self._passed:
            return
        self._passed[sample] = None
        if len(self._passed) > _REMEMBERED:
            self._passed.popitem(last=False)
        if kind[1] == DurabilityPolicy.VOLATILE:  # only these hear our nodes' live copies
            key = number, data
            if self._kept_alone.take(key):
                return
            # Somebody's copy can overtake the first message that is kept, which names the source.
            unheard = self._kept.get_publisher_count() > len(self._sources)
            if source and unheard and key in self._live_alone:
                return
            self._live_alone.add(key)
        self._take(data)

    def of_other_types(self) -> list[str]:
        """Return who publishes something else there, which nobody receives, a line each."""
        return [
            f"{self._topic}: {name} publishes {other} there, not {self._type_name}"
            for name, other in sorted(self.other_types.items())
        ]


def _kind(endpoint: TopicEndpointInfo) -> Kind:
    """Return the kind that a publisher offers; durability without reliability counts as volatile."""
    offered = endpoint.qos_profile
    if offered.reliability == ReliabilityPolicy.RELIABLE:
        return offered.reliability, offered.durability
    return offered.reliability, DurabilityPolicy.VOLATILE
