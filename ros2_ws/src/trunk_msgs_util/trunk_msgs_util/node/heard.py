"""`HeardTopic`: a topic heard from every publisher, whatever quality of service it offers, each message once.

DDS matches a subscription with those publishers alone that offer at least what it requests. Our nodes keep
their evidence (reliable, transient local) for a recorder that comes late; rclpy's and `ros2 topic pub`'s
default is volatile, a sensor's often best effort. No single subscription serves all: one that asks for the
past is deaf to the volatile, one that does not misses the past. So there is one for each kind that some
publisher offers, as rosbag2 adapts to what is offered, and a message that two of them receive is taken once.
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

from . import meeting, qos

Info: TypeAlias = Mapping[str, Any]  # what the middleware tells of a message
Key: TypeAlias = tuple[int, int]  # when its publisher sent a message, ns, and its number

# Twice what a publisher of evidence keeps: one that is matched late delivers all that at once.
_REMEMBERED = 2 * qos.EVIDENCE_DEPTH


@dataclass(eq=False)
class Source:
    """A publisher, told from the others by the numbers of its messages, which count from 1."""

    last: int
    missed: int = 0  # sent before it was heard, while the run went on
    lost: int = 0
    keeps_past: bool = False  # it delivers the past too: nothing was missed

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


class HeardTopic:
    """The subscriptions to one topic; ``other_types`` has the nodes that publish something else there."""

    def __init__(
        self,
        node: Node,
        topic: str,
        type_name: str,
        message_type: Any,
        profile: QoSProfile,
        take: Callable[[bytes], None],
        under_way: Callable[[], bool],
    ) -> None:
        """Subscribe with ``profile``; ``take`` gets each message, ``under_way`` tells if a run goes on."""
        self._node = node
        self._topic = topic
        self._type_name = type_name
        self._message_type = message_type
        self._take = take
        self._under_way = under_way
        self.other_types: dict[str, str] = {}
        self._sources: dict[ReliabilityPolicy, Sources] = {}
        self._seen: OrderedDict[Key, Source | None] = OrderedDict()
        self._looked_at = (0, 0)
        self._base = self._subscribe(profile, self._on_kept)
        self._passing: dict[ReliabilityPolicy, Subscription] = {}

    def _subscribe(self, profile: QoSProfile, on_message: Callable[..., None]) -> Subscription:
        return self._node.create_subscription(
            self._message_type,
            self._topic,
            on_message,
            profile,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=lambda _: self.look()),
        )

    @property
    def publisher_count(self) -> int:
        """How many publishers are matched."""
        return max(s.get_publisher_count() for s in (self._base, *self._passing.values()))

    def look(self) -> None:
        """Subscribe once more if a publisher offers less than what is requested; cheap if none is new."""
        found = (self._node.count_publishers(self._topic), self._base.get_publisher_count())
        if found == self._looked_at:
            return
        self._looked_at = found
        for endpoint in self._node.get_publishers_info_by_topic(self._topic):
            if endpoint.topic_type != self._type_name:
                self.other_types[meeting.names([endpoint])[0]] = endpoint.topic_type
            elif not _keeps_past(endpoint):
                self._hear_passing(endpoint.qos_profile.reliability)

    def _hear_passing(self, offered: ReliabilityPolicy) -> None:
        if offered in self._passing:
            return
        sources = self._sources[offered] = Sources()

        def on_message(data: bytes, info: Info) -> None:
            self._on_passing(data, info, sources, self._passing[offered])

        profile = QoSProfile(
            depth=qos.EVIDENCE_DEPTH, reliability=offered, durability=DurabilityPolicy.VOLATILE
        )
        self._passing[offered] = self._subscribe(profile, on_message)

    def _on_kept(self, data: bytes, info: Info) -> None:
        """Take a message of a publisher that keeps its past."""
        if self._passing:
            key = _key(info)
            if key in self._seen:
                source = self._seen[key]
                if source is not None:
                    source.keeps_past = True
                return
            self._remember(key, None)
        self._take(data)

    def _on_passing(
        self, data: bytes, info: Info, sources: Sources, subscription: Subscription
    ) -> None:
        """Take a message of any publisher that offers as much as this subscription requests."""
        key = _key(info)
        source = sources.of(key[1], subscription.get_publisher_count(), self._under_way())
        if key in self._seen:
            source.keeps_past = True  # or another subscription counts what it loses
            return
        self._remember(key, source)
        self._take(data)

    def _remember(self, key: Key, source: Source | None) -> None:
        self._seen[key] = source
        if len(self._seen) > _REMEMBERED:
            self._seen.popitem(last=False)

    def unheard(self) -> list[str]:
        """Return what was published but not received, a line each."""
        found = [
            f"{self._topic}: {name} publishes {other} there, not {self._type_name}"
            for name, other in sorted(self.other_types.items())
        ]
        strangers = [
            source
            for sources in self._sources.values()
            for source in sources.all
            if not source.keeps_past
        ]
        missed, lost = (sum(getattr(s, what) for s in strangers) for what in ("missed", "lost"))
        if missed:
            found.append(
                f"{self._topic}: {missed} messages were sent before the recorder heard them"
            )
        if lost:
            found.append(f"{self._topic}: {lost} messages were lost on the way")
        return found


def _keeps_past(endpoint: TopicEndpointInfo) -> bool:
    offered = endpoint.qos_profile
    reliable = offered.reliability == ReliabilityPolicy.RELIABLE
    return bool(reliable and offered.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def _key(info: Info) -> Key:
    return info["source_timestamp"], info["publication_sequence_number"]
