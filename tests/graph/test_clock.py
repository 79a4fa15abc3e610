"""Simulated time reaches other nodes before the states of its instant."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import stamp_from_ros

from .processes import Child, Children

pytestmark = pytest.mark.graph


@pytest.fixture
def watcher(domain: int) -> Iterator[Node]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("watcher", context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.mark.parametrize("topic", [topics.JOINT_STATES, topics.GROUND_TRUTH])
def test_the_clock_is_published_before_its_states(
    children: Children, watcher: Node, topic: str
) -> None:
    """By the middleware's write times: a node that has both waiting may still take a state first."""
    written: dict[str, dict[int, int]] = {"clock": {}, "state": {}}

    def on_clock(clock: Clock, info: dict[str, int]) -> None:
        written["clock"].setdefault(stamp_from_ros(clock.clock), info["source_timestamp"])

    def on_state(state: JointState, info: dict[str, int]) -> None:
        written["state"][stamp_from_ros(state.header.stamp)] = info["source_timestamp"]

    every = QoSProfile(depth=1000, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    watcher.create_subscription(Clock, "/clock", on_clock, every)
    watcher.create_subscription(JointState, topic, on_state, every)
    simulator: Child = children.node("simulator", "publish_clock:=true", "wait_for:=[]")
    executor = SingleThreadedExecutor(context=watcher.context)
    executor.add_node(watcher)
    both: set[int] = set()
    while len(both) < 50 and simulator.process.poll() is None:
        executor.spin_once()
        both = written["clock"].keys() & written["state"].keys()
    executor.shutdown()
    simulator.stop()
    assert len(both) == 50
    assert all(written["clock"][stamp] < written["state"][stamp] for stamp in both)
