"""A state that somebody else publishes does not pass for one of the run's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node.conversions import sample_to_ros
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.samples import JointSample

from .peer import Peer
from .processes import Children
from .services import Services

pytestmark = pytest.mark.graph


@pytest.mark.parametrize(
    ("topic", "says"),
    [
        pytest.param(  # from there on stamps go back
            topics.GROUND_TRUTH, "it holds 2 runs", marks=pytest.mark.long
        ),
        (topics.JOINT_STATES, r"(\d+) messages for \d+ states: another node publishes there too"),
    ],
)
def test_a_stranger_publishes_a_state_from_the_far_future(
    children: Children, peer: Peer, tmp_path: Path, topic: str, says: str
) -> None:
    held = ("--set", "simulator.autostart=false")  # until the stranger has spoken
    run = children.trunk("run", "demo", "--duration", 1, "--output", "run", *held)
    assert Services(peer, "simulator").change("configure")
    stranger = peer.publisher(topic, "recorder")
    peer.until_event("recorder", Event.READY)
    far_ns = (2**31 - 1) * 10**9
    state = JointSample(far_ns, ("hip", "trunk"), (0.0, 0.1), (0.0, 0.0), (0.0, 0.0))
    stranger.publish(sample_to_ros(state))
    peer.until_received(stranger)
    assert Services(peer, "simulator").change("activate")
    assert run.wait() != 0
    assert run.stdout.startswith("INCOMPLETE: ")
    assert re.search(says, run.stdout)
    children.none_left()
    assert verify(Recording.open(tmp_path / "run" / "run.mcap")).exit_code != VERIFIED
