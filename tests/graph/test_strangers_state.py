"""A state that somebody else publishes does not pass for one of the run's."""

from __future__ import annotations

from pathlib import Path

import pytest

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.samples import JointSample

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph


@pytest.mark.parametrize(
    ("topic", "says"),
    [
        pytest.param(  # from there on stamps go back
            topics.GROUND_TRUTH, "it holds 2 runs", marks=pytest.mark.long
        ),
        (topics.JOINT_STATES, "802 messages for 801 states: another node publishes there too"),
    ],
)
def test_a_stranger_publishes_a_state_from_the_far_future(
    children: Children, peer: Peer, tmp_path: Path, topic: str, says: str
) -> None:
    run = children.trunk("run", "demo", "--duration", 4, "--output", "run")
    speak = peer.speaker(topic)
    peer.until_started(run)
    speak(JointSample((2**31 - 1) * 10**9, ("hip", "trunk"), (0.0, 0.1), (0.0, 0.0), (0.0, 0.0)))
    assert run.wait() != 0
    assert run.stdout.startswith("INCOMPLETE: ")
    assert says in run.stdout
    children.none_left()
    assert verify(Recording.open(tmp_path / "run" / "run.mcap")).exit_code != VERIFIED
