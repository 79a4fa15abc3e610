"""What a recorder follows: nodes of any name, and commands of several controllers in any order."""

from __future__ import annotations

from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.samples import JointSample

from .peer import Peer
from .processes import Child, Children

pytestmark = pytest.mark.graph


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("lockstep", ["false", "true"])
def test_nodes_of_any_name_are_recorded_and_judged(
    children: Children, peer: Peer, tmp_path: Path, lockstep: str
) -> None:
    def start(executable: str, name: str, *more: str) -> Child:
        mode = f"lockstep.enabled:={lockstep}"
        return children.node(executable, "-r", f"__node:={name}", mode, *more)

    recorder = start("recorder", "tape", "output:=run.mcap")
    peer.until_event("tape", Event.ACTIVATED)
    controller = start("pid", "balance")
    peer.until_event("balance", Event.ACTIVATED)
    simulator = start("simulator", "plant", "duration:=0.5", "wait_for:=[effort_command, recorder]")
    assert simulator.wait() == 0, simulator.stderr
    assert controller.stop() == 0, controller.stderr
    assert recorder.stop() == 0, recorder.stderr
    counts = {
        name: topic.count for name, topic in Recording.open(tmp_path / "run.mcap").topics.items()
    }
    assert counts["/balance/state"] == counts["/effort_command"] > 0
    assert not any("fuzzy_pid" in name for name in counts)
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.complete, recording.warnings
    assert recording.controllers == ["pid"]  # goes by what it is
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    assert verdict.checks[0].name == "commands of pid"
    assert "pid is the node /balance" in verdict.notes
    explained = children.trunk("explain", "run.mcap", "--at", "0.1", name="explain")
    assert explained.wait() == 0, explained.stderr


def test_commands_of_another_controller_that_come_late_hold_nothing_up(
    children: Children, peer: Peer
) -> None:
    """After a swap, the first controller's commands may arrive after the last ones of the second."""
    recorder = children.node("recorder", "output:=run.mcap", "lockstep.enabled:=true")
    told: list[JointState] = []
    peer.node.create_subscription(JointState, topics.RECORDER_PROGRESS, told.append, qos.latest())
    command = peer.speaker(topics.evidence(topics.EFFORT_COMMAND))
    states = [peer.speaker(topics.evidence(t)) for t in (topics.GROUND_TRUTH, topics.JOINT_STATES)]

    def told_ns() -> int:
        return stamp_from_ros(told[-1].header.stamp) if told else -1

    for stamp_ns in (0, 10_000_000, 5_000_000):
        command(JointSample(stamp_ns, ("trunk",), effort=(1.0,)))
    for say in states:
        say(JointSample(0, ("hip", "trunk"), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)))
    peer.until(lambda: told_ns() >= 0, "the late command is written")
    for say in states:
        say(JointSample(10_000_000, ("hip", "trunk"), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)))
    peer.until(lambda: told_ns() == 10_000_000, "the last state is written")
    assert recorder.stop() == 0, recorder.stderr
