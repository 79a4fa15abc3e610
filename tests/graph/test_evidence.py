"""What a node has published is recorded before the node ends, or the recording says what is missing."""

import signal
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import sample_to_ros, stamp_from_ros
from trunk_recording.reader import Recording
from trunk_recording.schemas import event as encoded

from .peer import Peer
from .processes import Children, until

pytestmark = [pytest.mark.graph, pytest.mark.virtual]


@pytest.mark.usefixtures("patient")
def test_a_node_ends_when_its_evidence_is_recorded(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """The node waits for a recorder that has not discovered anyone yet, as on a busy machine."""
    pid = children.node("pid")
    say = peer.speaker(topics.JOINT_STATES)
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    until((tmp_path / "run.mcap").exists, "the recorder has begun its file")
    recorder.send(signal.SIGSTOP)
    for k in range(10):
        say(JointSample(5_000_000 * k, ("hip", "trunk"), (0.0, 0.1), (0.0, 0.0), (0.0, 0.0)))
    # Who hears what is kept counts as a recorder, and who hears what is live may come late.
    peer.until(lambda: peer.last_diagnostics("pid")["time"] == "0.045", "pid has answered all")
    pid.send(signal.SIGINT)
    peer.until_event("pid", "published")
    recorder.send(signal.SIGCONT)
    assert pid.wait() == 0, pid.stderr
    peer.until_recorded(30)  # the states, too
    assert recorder.stop() == 0, recorder.stderr
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.topics["/pid/state"].count == 10
    assert recording.topics["/effort_command"].count == 10
    told = [event for event in recording.events("/run/events") if event.message == "published"]
    assert [event.values for event in told] == [{"/effort_command": "10", "/pid/state": "10"}]


def test_what_was_published_and_not_recorded_is_named(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid,fuzzy_pid]")
    pid = children.node("pid")
    simulator = children.node("simulator", "duration:=0.0")
    peer.until_recorded(100)
    # A controller that ended so soon that the recorder received only its last events.
    publisher = peer.node.create_publisher(
        DiagnosticArray, topics.RUN_EVENTS, qos.run_information()
    )
    counts = {"/fuzzy_pid/state": 7, "/effort_command": 0, "/elsewhere": 9}
    peer.until(lambda: publisher.get_subscription_count() == 3, "simulator and recorder listen too")
    publisher.publish(encoded(0, "/fuzzy_pid", "published", counts))
    peer.until_received(publisher)
    assert [simulator.stop(), pid.stop()] == [0, 0]
    peer.until_event("simulator", "finished")
    assert recorder.stop() == 1, recorder.stderr
    recording = Recording.open(tmp_path / "run.mcap")
    assert not recording.complete
    assert recording.warnings == ["incomplete: fuzzy_pid/state: 0 of 7 messages were recorded"]


def test_a_recorder_that_comes_seconds_late_gets_all(peer: Peer) -> None:
    publisher = peer.node.create_publisher(JointState, topics.evidence("a"), qos.evidence())
    stamps_ns = [1_000_000 * k for k in range(2000)]  # of two seconds at a kilohertz
    for stamp_ns in stamps_ns:
        publisher.publish(sample_to_ros(JointSample(stamp_ns, ("trunk",))))
    heard = peer.hear("a")
    peer.until(lambda: heard and stamp_of(heard[-1]) == stamps_ns[-1], "the last one has come")
    assert [stamp_of(message) for message in heard] == stamps_ns


def stamp_of(message: JointState) -> int:
    return stamp_from_ros(message.header.stamp)
