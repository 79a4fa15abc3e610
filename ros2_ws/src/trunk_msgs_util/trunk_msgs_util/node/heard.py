"""`HeardTopic`: a topic heard from every publisher, whatever its quality of service, each message once.

DDS matches a subscription only with publishers that offer at least what it requests. Our nodes keep what
they publish for a recorder that joins late, on a separate topic (`topics.evidence`). Others publish only on
the live topic: rclpy and `ros2 topic pub` are volatile by default, and a sensor is often best effort. No
single subscription serves all of them: one that requests past messages does not match volatile publishers,
one that does not misses the past. So there is one more for each kind that some other publisher offers, just
as rosbag2 adapts to what is offered. A message that several subscriptions receive has the same time and
number in each, and is taken once. Such a subscription also hears our nodes' live copies; they have the
number and the bytes of the kept ones.
"""

from __future__ import annotations

from collections import OrderedDict
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

Info: TypeAlias = Mapping[str, Any]  # what the middleware reports about a message
Key: TypeAlias = tuple[
    int, bytes
]  # number and bytes: the same for the copy that is kept and the live one
Sample: TypeAlias = tuple[
    int, int, bytes
]  # when it was published, number and bytes: one message alone
Kind: TypeAlias = tuple[ReliabilityPolicy, DurabilityPolicy]

# Twice what a publisher of evidence keeps: one that is matched late delivers all of it at once.
_REMEMBERED = 2 * qos.EVIDENCE_DEPTH
# A publisher whose node is still unknown after this many looks counts as somebody else's.
_UNNAMED_LOOKS = 20


@dataclass(eq=False)
class Source:
    """A publisher, distinguished from others by its messages' numbers, which count from 1."""

    last: int
    missed: int = 0  # sent before it was heard, while the run went on
    lost: int = 0
    elsewhere: bool = False  # another subscription hears it too, and misses nothing

    def take(self, number: int) -> None:
        """Take the next message."""
        self.lost += max(number - self.last - 1, 0)
        self.last = number


class Sources:
    """The publishers of one topic; the middleware gives the messages' numbers, but not their publishers."""

    def __init__(self) -> None:
        self.all: list[Source] = []

    def of(self, number: int, publishers: int, under_way: bool) -> Source:
        """Return the source of a message, given the number of known publishers."""
        following = [source for source in self.all if source.last < number]
        source = max(following, key=lambda source: source.last, default=None)
        if source is None or (source.last + 1 < number and len(self.all) < publishers):
            source = Source(number, number - 1 if under_way else 0)
            self.all.append(source)
        else:
            source.take(number)
        return source


@dataclass(eq=False)
class Passing:
    """A message that was heard on the live topic, by one subscription or several."""

    kind: Kind  # of the first of them
    source: Source
    also: list[Source]
    ours: bool = False  # the live copy of one that is kept

    def belongs_to_ours(self) -> None:
        """Note that its publisher is a node of ours: what was missed is among the kept messages."""
        self.ours = True
        for source in (self.source, *self.also):
            source.elsewhere = True


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
        """Subscribe; ``take`` gets each message, ``under_way`` tells if a run is under way."""
        self._node = node
        self._topic = topic
        self._type_name = type_name
        self._message_type = message_type
        self._take = take
        self._under_way = under_way
        self.other_types: dict[str, str] = {}
        self.of_ours = 0  # messages of our own nodes
        self._passed: OrderedDict[Sample, Passing] = OrderedDict()
        # Our nodes publish each message twice: here are those taken once, whose other copy is still to come.
        self._kept_alone: OrderedDict[Key, int] = OrderedDict()
        self._live_alone: OrderedDict[Key, list[Passing]] = OrderedDict()
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
        """The number of matched publishers of the subscription that has most."""
        subscriptions = (self._kept, *(subscription for subscription, _ in self._passing.values()))
        return max(subscription.get_publisher_count() for subscription in subscriptions)

    @property
    def by_strangers(self) -> bool:
        """True if nodes that keep no evidence publish there, too."""
        return bool(self._passing)

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
            self._on_passing(data, info, kind, *self._passing[kind])

        profile = QoSProfile(depth=qos.EVIDENCE_DEPTH, reliability=kind[0], durability=kind[1])
        self._passing[kind] = self._subscribe(self._topic, profile, on_message), sources

    def _on_kept(self, data: bytes, info: Info) -> None:
        """Take a message of a node of ours, unless its live copy was taken."""
        self.of_ours += 1
        if self._passing:
            key = info["publication_sequence_number"], data
            copies = self._live_alone.pop(key, [])
            if copies:
                copies.pop().belongs_to_ours()
                if copies:
                    self._live_alone[key] = copies
                return
            self._kept_alone[key] = self._kept_alone.get(key, 0) + 1
            _forget_first(self._kept_alone)
        self._take(data)

    def _on_passing(
        self, data: bytes, info: Info, kind: Kind, subscription: Subscription, sources: Sources
    ) -> None:
        """Take a message of any publisher that offers as much as this subscription requests.

        A message has the same source time in every subscription that hears it.
        """
        number = info["publication_sequence_number"]
        source = sources.of(number, subscription.get_publisher_count(), self._under_way())
        sample = info["source_timestamp"], number, data
        known = self._passed.get(sample)
        if known is not None:
            # The subscription that requests more hears more of it.
            less = source if _asks(kind) < _asks(known.kind) else known.source
            less.elsewhere = True
            known.also.append(source)
            if known.ours:
                known.belongs_to_ours()
            return
        passing = self._passed[sample] = Passing(kind, source, [])
        _forget_first(self._passed)
        if kind[1] == DurabilityPolicy.VOLATILE:  # only these hear our nodes' live copies
            key = number, data
            kept = self._kept_alone.pop(key, 0)
            if kept:
                passing.belongs_to_ours()
                if kept > 1:
                    self._kept_alone[key] = kept - 1
                return
            self._live_alone.setdefault(key, []).append(passing)
            _forget_first(self._live_alone)
        self._take(data)

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
            found.append(
                f"{self._topic}: {missed} messages were sent before the recorder could receive them"
            )
        if lost:
            found.append(f"{self._topic}: {lost} messages were lost in transit")
        return found


def _asks(kind: Kind) -> tuple[bool, bool]:
    """Return how much a subscription of this kind requests, for comparison."""
    return kind[0] == ReliabilityPolicy.RELIABLE, kind[1] != DurabilityPolicy.VOLATILE


def _forget_first(remembered: OrderedDict[Any, Any]) -> None:
    if len(remembered) > _REMEMBERED:
        remembered.popitem(last=False)


def _kind(endpoint: TopicEndpointInfo) -> Kind:
    """Return what a publisher offers; durability without reliability counts as volatile."""
    offered = endpoint.qos_profile
    if offered.reliability == ReliabilityPolicy.RELIABLE:
        return offered.reliability, offered.durability
    return offered.reliability, DurabilityPolicy.VOLATILE
