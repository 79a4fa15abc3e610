"""`HeardTopic`: a topic heard from every publisher, whatever quality of service it offers, each message once.

DDS matches a subscription with those publishers alone that offer at least what it requests. Our nodes keep
what they publish for a recorder that comes late, on a topic of its own (`topics.evidence`). Others publish on
the live topic alone: rclpy's and `ros2 topic pub`'s default is volatile, a sensor's often best effort. No
single subscription serves all of them: one that asks for the past is deaf to the volatile, one that does not
misses the past. So there is one more for each kind that some other publisher offers, as rosbag2 adapts to
what is offered, and a message that several subscriptions receive is taken once.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from .. import topics
from . import meeting, qos

Info: TypeAlias = Mapping[str, Any]  # what the middleware tells of a message
Kind: TypeAlias = tuple[ReliabilityPolicy, DurabilityPolicy]

# Twice what a publisher of evidence keeps: one that is matched late delivers all that at once.
_REMEMBERED = 2 * qos.EVIDENCE_DEPTH
# So many looks a publisher may have no known node before it counts as somebody else's.
_UNNAMED_LOOKS = 20


@dataclass(eq=False)
class Source:
    """A publisher, told from the others by the numbers of its messages, which count from 1."""

    last: int
    missed: int = 0  # sent before it was heard, while the run went on
    lost: int = 0
    elsewhere: bool = False  # another subscription hears it too, and misses nothing

    def take(self, number: int) -> None:
        """Take the next message."""
        self.lost += max(number - self.last - 1, 0)
        self.last = number


class Sources:
    """The publishers of one topic; the middleware tells the messages' numbers, but not whose they are."""

    def __init__(self) -> None:
        self.all: list[Source] = []

    def of(self, number: int, publishers: int, under_way: bool) -> Source:
        """Return the source of a message, where so many publishers are known."""
        following = [source for source in self.all if source.last < number]
        source = max(following, key=lambda source: source.last, default=None)
        if source is None or (source.last + 1 < number and len(self.all) < publishers):
            source = Source(number, number - 1 if under_way else 0)
            self.all.append(source)
        else:
            source.take(number)
        return source


@dataclass(eq=False)
class Taken:
    """A message that was taken: how often each subscription received it; of equal ones, none is left out."""

    received: Counter[Subscription]
    count: int = 0
    source: Source | None = None


class HeardTopic:
    """The subscriptions to one topic; ``other_types`` has the nodes that publish something else there."""

    def __init__(
        self,
        node: Node,
        topic: str,
        type_name: str,
        message_type: Any,
        take: Callable[[bytes], None],
        under_way: Callable[[], bool],
    ) -> None:
        """Subscribe; ``take`` gets each message, ``under_way`` tells if a run goes on."""
        self._node = node
        self._topic = topic
        self._type_name = type_name
        self._message_type = message_type
        self._take = take
        self._under_way = under_way
        self.other_types: dict[str, str] = {}
        self._taken: OrderedDict[bytes, Taken] = OrderedDict()
        self._passing: dict[Kind, tuple[Subscription, Sources]] = {}
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
        """How many publishers are matched, at most those of one subscription."""
        subscriptions = (self._kept, *(subscription for subscription, _ in self._passing.values()))
        return max(subscription.get_publisher_count() for subscription in subscriptions)

    def look(self) -> None:
        """Subscribe once more for a publisher that no subscription receives; cheap if none is new."""
        found = (self._node.count_publishers(self._topic), self._kept.get_publisher_count())
        if found == self._looked_at:
            return
        self._looked_at = found
        keep = meeting.publishers(self._node, self._kept_topic)
        for endpoint in self._node.get_publishers_info_by_topic(self._topic):
            name = meeting.names([endpoint])[0]
            if name in keep:
                continue
            if name.endswith(topics.UNKNOWN_NODE) and self._unnamed_looks < _UNNAMED_LOOKS:
                self._unnamed_looks += 1
                self._looked_at = (-1, -1)  # look again
            elif endpoint.topic_type != self._type_name:
                self.other_types[name] = endpoint.topic_type
            else:
                self._hear_passing(_kind(endpoint))

    def _hear_passing(self, kind: Kind) -> None:
        if kind in self._passing:
            return
        sources = Sources()

        def on_message(data: bytes, info: Info) -> None:
            self._on_passing(data, info, *self._passing[kind])

        profile = QoSProfile(depth=qos.EVIDENCE_DEPTH, reliability=kind[0], durability=kind[1])
        self._passing[kind] = self._subscribe(self._topic, profile, on_message), sources

    def _on_kept(self, data: bytes) -> None:
        """Take a message of a node of ours."""
        if not self._passing or self._receive(data, self._kept) is not None:
            self._take(data)

    def _on_passing(
        self, data: bytes, info: Info, subscription: Subscription, sources: Sources
    ) -> None:
        """Take a message of any publisher that offers as much as this subscription requests."""
        number = info["publication_sequence_number"]
        source = sources.of(number, subscription.get_publisher_count(), self._under_way())
        taken = self._receive(data, subscription)
        if taken is None:
            source.elsewhere = True
            return
        taken.source = source
        self._take(data)

    def _receive(self, data: bytes, subscription: Subscription) -> Taken | None:
        """Return the message's entry if it is to be taken, None if another subscription's was.

        Of equal messages, as many are taken as some one subscription has received.
        """
        taken = self._taken.get(data)
        if taken is None:
            taken = self._taken[data] = Taken(Counter())
            if len(self._taken) > _REMEMBERED:
                self._taken.popitem(last=False)
        taken.received[subscription] += 1
        if taken.received[subscription] <= taken.count:
            if taken.source is not None:
                taken.source.elsewhere = True
            return None
        taken.count += 1
        return taken

    def unheard(self) -> list[str]:
        """Return what was published but not received, a line each."""
        found = [
            f"{self._topic}: {name} publishes {other} there, not {self._type_name}"
            for name, other in sorted(self.other_types.items())
        ]
        strangers = [
            source
            for _, sources in self._passing.values()
            for source in sources.all
            if not source.elsewhere
        ]
        missed, lost = (sum(getattr(s, what) for s in strangers) for what in ("missed", "lost"))
        if missed:
            found.append(f"{self._topic}: {missed} messages were sent before they were heard")
        if lost:
            found.append(f"{self._topic}: {lost} messages were lost on the way")
        return found


def _kind(endpoint: TopicEndpointInfo) -> Kind:
    """Return what a publisher offers; what is kept without being reliable is taken as not kept."""
    offered = endpoint.qos_profile
    if offered.reliability == ReliabilityPolicy.RELIABLE:
        return offered.reliability, offered.durability
    return offered.reliability, DurabilityPolicy.VOLATILE
