"""The recorder hears every publisher, whatever quality of service it offers, or says what it missed."""

from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import sample_to_ros, stamp_from_ros
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.samples import JointSample

from .peer import Peer
from .processes import Child, Children

pytestmark = pytest.mark.graph

COUNT = 300
DEFAULT = QoSProfile(depth=10)


def recorded(recorder: Child, folder: Path) -> Recording:
    assert recorder.stop() == 0, recorder.stderr
    return Recording.open(folder / "run.mcap")


@pytest.mark.parametrize(
    "topic", [topics.EFFORT_COMMAND, topics.REFERENCE, topics.DISTURBANCE, topics.JOINT_STATES]
)
@pytest.mark.parametrize(
    "profiles",
    [[DEFAULT], [qos_profile_sensor_data], [DEFAULT, qos.evidence(), qos_profile_sensor_data]],
    ids=["default", "best effort", "all three"],
)
def test_every_message_is_recorded_once(
    children: Children, peer: Peer, tmp_path: Path, topic: str, profiles: list[QoSProfile]
) -> None:
    recorder = children.node("recorder", "output:=run.mcap")
    peer.until_event("recorder", Event.ACTIVATED)
    publishers = [peer.node.create_publisher(JointState, topic, profile) for profile in profiles]
    for publisher in publishers:
        peer.until(publisher.get_subscription_count, "the recorder listens")
    heard = 0
    for k in range(COUNT):
        for n, publisher in enumerate(publishers):
            publisher.publish(sample_to_ros(JointSample(k, ("trunk",), (float(n),))))
            heard += 1
        peer.spin()
    peer.until_recorded(heard)
    stamps = recorded(recorder, tmp_path).joints(f"/{topic}").stamp_ns.tolist()
    assert sorted(stamps) == sorted([*range(COUNT)] * len(publishers))


def test_a_controller_of_ten_lines_is_recorded_in_lockstep(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """With rclpy's default quality of service; the plant waits for it and for the recorder."""
    recorder = children.node("recorder", "output:=run.mcap", "lockstep.enabled:=true")
    command = peer.node.create_publisher(JointState, topics.EFFORT_COMMAND, 10)

    def on_state(state: JointState) -> None:
        answer = JointState(header=state.header, name=["trunk"])
        answer.effort = [-200.0 * state.position[1] - 20.0 * state.velocity[1]]
        command.publish(answer)

    peer.node.create_subscription(JointState, topics.JOINT_STATES, on_state, 10)
    simulator = children.node(
        "simulator",
        "lockstep.enabled:=true",
        "duration:=1.0",
        "wait_for:=[effort_command, recorder]",
    )
    peer.until(lambda: simulator.process.poll() is not None, "the run ends")
    assert simulator.wait() == 0, simulator.stderr
    found = recorded(recorder, tmp_path)
    assert found.complete, found.warnings
    counts = [
        found.topics[f"/{topic}"].count
        for topic in (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND)
    ]
    assert counts == [201, 201, 201]


def test_what_is_of_another_type_is_named(children: Children, peer: Peer, tmp_path: Path) -> None:
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    peer.node.create_publisher(Float64, topics.REFERENCE, 10)
    pid, simulator = children.node("pid"), children.node("simulator", "duration:=0.0")
    peer.until_recorded(200)
    assert [simulator.stop(), pid.stop()] == [0, 0]
    assert recorded(recorder, tmp_path).warnings == [
        "incomplete: reference: /peer publishes std_msgs/msg/Float64 there, not sensor_msgs/msg/JointState"
    ]


def test_who_looks_at_a_live_topic_sees_the_present(children: Children, peer: Peer) -> None:
    """Tools ask for what is offered: the past only where it is kept, which is nowhere they look."""
    simulator = children.node("simulator", "duration:=0.0", "wait_for:=[]")
    kept = peer.hear(topics.GROUND_TRUTH)
    peer.until(lambda: len(kept) > 100, "half a second is past")
    offered = peer.node.get_publishers_info_by_topic(topics.GROUND_TRUTH)
    assert [found.qos_profile.durability for found in offered] == [DurabilityPolicy.VOLATILE]
    seen = peer.hear_live(topics.GROUND_TRUTH)
    peer.until(lambda: seen, "a state comes")
    assert stamp_from_ros(seen[0].header.stamp) >= stamp_from_ros(kept[100].header.stamp)
    assert simulator.stop() == 0, simulator.stderr
