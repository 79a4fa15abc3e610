"""Who has met whom: DDS finds each direction by itself, and what is sent in between is lost to the other.

A subscription that wants nothing from the past gets what is published once its publisher has found it. So a
node that is to answer states says that it is ready when the one who publishes them hears its answers, and
that one begins when it has found the node that is to hear them.
"""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ..topics import UNKNOWN_NODE


def names(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the full name of the node behind each endpoint."""
    return [f"{found.node_namespace.rstrip('/')}/{found.node_name}" for found in endpoints]


def known(endpoints: Iterable[TopicEndpointInfo]) -> set[str]:
    """Return the nodes whose names are known."""
    return {name for name in names(endpoints) if not name.endswith(UNKNOWN_NODE)}


def publishers(node: Node, topic: str) -> set[str]:
    """Return the nodes that are known to publish on a topic."""
    return known(node.get_publishers_info_by_topic(topic))


def listeners(node: Node, topic: str) -> set[str]:
    """Return the nodes that are known to listen to a topic."""
    return known(node.get_subscriptions_info_by_topic(topic))


def met(node: Node, hears: str, answers: str) -> bool:
    """Return True where who publishes on ``hears`` has been found, also as a listener to ``answers``."""
    return bool(publishers(node, hears) & listeners(node, answers))
