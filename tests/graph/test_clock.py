"""Simulated time reaches other nodes before the states of its instant."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from trunk_msgs_util import topics
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import stamp_from_ros

from .processes import Child, Children

pytestmark = pytest.mark.graph


@pytest.fixture
def watcher(domain: int) -> Iterator[Node]:
    """A node that lives by the run's clock."""
    context = rclpy.Context()
    rclpy.init(context=context)
    by_the_clock = Parameter("use_sim_time", value=True)
    node = Node("watcher", context=context, parameter_overrides=[by_the_clock])
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.mark.parametrize("topic", [topics.JOINT_STATES, topics.GROUND_TRUTH])
def test_no_state_is_of_the_future(children: Children, watcher: Node, topic: str) -> None:
    delays_ns: list[int] = []

    def on_state(state: JointState) -> None:
        now_ns = watcher.get_clock().now().nanoseconds
        if now_ns:  # the clock is known
            delays_ns.append(now_ns - stamp_from_ros(state.header.stamp))

    watcher.create_subscription(JointState, topic, on_state, qos.live())
    simulator: Child = children.node(
        "simulator", "publish_clock:=true", "wait_for:=[]", "duration:=1.0"
    )
    executor = SingleThreadedExecutor(context=watcher.context)
    executor.add_node(watcher)
    while simulator.process.poll() is None:
        executor.spin_once(timeout_sec=0.02)
    executor.shutdown()
    assert simulator.wait() == 0, simulator.stderr
    assert delays_ns
    assert min(delays_ns) >= 0
