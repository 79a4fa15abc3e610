"""Which nodes are matched in both directions.

DDS discovers each direction separately, and a volatile subscription misses whatever is published before its
publisher has discovered it. So a node that answers states reports that it is ready once the publisher of the
states subscribes to its answers, and that publisher starts once it has discovered the node as a subscriber.

Through a discovery server a node learns only of topics on which it has an endpoint itself, and only of the
endpoints at the other end: who subscribes to what it publishes, and who publishes what it subscribes to.
Nothing else is asked for here.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from .. import topics
from ..topics import UNKNOWN_NODE

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


def met(node: Node, hears: str, answers: str) -> bool:
    """Return True if a publisher of ``hears`` is known that also subscribes to ``answers``."""
    return bool(publishers(node, hears) & listeners(node, answers))
