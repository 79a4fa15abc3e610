"""Simulated time reaches other nodes before the states of its instant."""

from __future__ import annotations

import pytest
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import stamp_from_ros

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("topic", [topics.JOINT_STATES, topics.GROUND_TRUTH])
def test_the_clock_is_published_before_its_states(
    children: Children, peer: Peer, topic: str
) -> None:
    """By the middleware's write times: a node that has both waiting may still take a state first."""
    written: dict[str, dict[int, int]] = {"clock": {}, "state": {}}

    def on_clock(clock: Clock, info: dict[str, int]) -> None:
        written["clock"].setdefault(stamp_from_ros(clock.clock), info["source_timestamp"])

    def on_state(state: JointState, info: dict[str, int]) -> None:
        written["state"][stamp_from_ros(state.header.stamp)] = info["source_timestamp"]

    every = QoSProfile(depth=1000, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    peer.node.create_subscription(Clock, "/clock", on_clock, every)
    peer.node.create_subscription(JointState, topic, on_state, every)
    simulator = children.node("simulator", "publish_clock:=true", "wait_for:=[]")
    both = peer.until(
        lambda: len(found := written["clock"].keys() & written["state"].keys()) >= 50 and found,
        "fifty states, and their clocks",
    )
    simulator.stop()
    assert all(written["clock"][stamp] < written["state"][stamp] for stamp in both)
