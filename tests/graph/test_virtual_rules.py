"""The rules of the virtual network (tests/seeds) are those of the middleware."""

from itertools import product

import pytest
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from std_msgs.msg import Int32

from ..seeds.network import Network, Quality, Reader, Writer, compatible
from ..seeds.world import NS, HungError, Process, World
from .peer import Peer

pytestmark = pytest.mark.graph

RELIABILITY = {1: ReliabilityPolicy.RELIABLE, 2: ReliabilityPolicy.BEST_EFFORT}
DURABILITY = {1: DurabilityPolicy.TRANSIENT_LOCAL, 2: DurabilityPolicy.VOLATILE}


def profile(quality: Quality) -> QoSProfile:
    return QoSProfile(
        depth=quality.depth,
        reliability=RELIABILITY[quality.reliability],
        durability=DURABILITY[quality.durability],
    )


KINDS = [Quality(r, d, 5) for r, d in product((1, 2), (1, 2))]


@pytest.mark.parametrize(("offered", "requested"), list(product(KINDS, KINDS)))
def test_the_same_qualities_are_compatible(offered: Quality, requested: Quality) -> None:
    found, _ = qos_check_compatible(profile(offered), profile(requested))
    assert compatible(offered, requested) == (found != QoSCompatibility.ERROR)


def virtual(offered: Quality, requested: Quality, before: int, after: int) -> list[int]:
    """Publish some messages before a subscription exists, and some once both know each other."""
    world = World(1)
    network: Network = world.network
    processes = [Process(name, world, lambda: 0, i, {}) for i, name in enumerate(("a", "b"))]
    world.processes += processes
    for process in processes:
        process.context = object()

    def settle() -> None:
        with pytest.raises(HungError, match="nothing is left"):
            world.run(lambda: False, 1000 * NS)

    writer: Writer = network.writer(processes[0], ("a", "/"), "/t", "T", offered)
    settle()
    for i in range(before):
        network.publish(writer, bytes([i]))
    reader: Reader = network.reader(processes[1], ("b", "/"), "/t", "T", requested)
    settle()
    for i in range(before, before + after):
        network.publish(writer, bytes([i]))
        settle()
    return [message.data[0] for message in reader.queue]


def real(peer: Peer, offered: Quality, requested: Quality, before: int, after: int) -> list[int]:
    """Do the same with two real nodes; nothing is taken before all has arrived."""
    one, other = Node("one", context=peer.node.context), Node("other", context=peer.node.context)
    publisher = one.create_publisher(Int32, "t", profile(offered))
    for i in range(before):
        publisher.publish(Int32(data=i))
    subscription = other.create_subscription(Int32, "t", lambda _: None, profile(requested))
    if compatible(offered, requested):
        peer.until(
            lambda: publisher.get_subscription_count() and subscription.get_publisher_count(),
            "they have met",
        )
        publisher.wait_for_all_acked()  # else the history would drop what is new to a late subscription
    for i in range(before, before + after):
        publisher.publish(Int32(data=i))
    marker = one.create_publisher(Int32, "last", 10)
    last = other.create_subscription(Int32, "last", lambda _: None, 10)
    peer.until(lambda: marker.get_subscription_count() and last.get_publisher_count(), "a marker")
    publisher.wait_for_all_acked()
    marker.publish(Int32(data=0))
    peer.until(lambda: last.handle.take_message(Int32, False) is not None, "the marker is there")
    found = []
    while (taken := subscription.handle.take_message(Int32, False)) is not None:
        found.append(taken[0].data)
    one.destroy_node()
    other.destroy_node()
    return found


@pytest.mark.parametrize(
    ("offered", "requested", "before", "after", "expected"),
    [
        (Quality(1, 1, 3), Quality(1, 1, 10), 5, 2, [2, 3, 4, 5, 6]),  # kept messages come late
        (Quality(1, 1, 10), Quality(1, 2, 10), 5, 2, [5, 6]),  # volatile: nothing from before
        (Quality(1, 2, 10), Quality(1, 2, 3), 0, 7, [4, 5, 6]),  # the queue keeps the newest
        (Quality(1, 1, 10), Quality(1, 1, 3), 5, 0, [2, 3, 4]),
        (Quality(2, 2, 10), Quality(1, 2, 10), 0, 4, []),  # it offers less: not matched
        (Quality(1, 2, 10), Quality(1, 1, 10), 3, 3, []),
    ],
)
def test_the_same_messages_arrive(
    peer: Peer, offered: Quality, requested: Quality, before: int, after: int, expected: list[int]
) -> None:
    assert virtual(offered, requested, before, after) == expected
    assert real(peer, offered, requested, before, after) == expected
