"""What somebody else publishes does not pass for the run's own: a state, or an operator's push."""

import re
from pathlib import Path

import pytest

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_evidence.judgement import DIVERGES, UNJUDGED, verify
from trunk_msgs_util.node.conversions import sample_to_ros
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Children
from .services import Services

pytestmark = pytest.mark.graph

FAR_NS = (2**31 - 1) * 10**9
FUTURE = JointSample(FAR_NS, ("hip", "trunk"), (0.0, 0.1), (0.0, 0.0), (0.0, 0.0))
PUSH = JointSample(0, ("hip", "trunk"), effort=(0.0, 5.0))
LOCKSTEP = ("--lockstep", "--set", "simulator.lockstep.speed=0.2")
AGAIN = r"(\d+) messages for \d+ states: another node publishes there too"


@pytest.mark.parametrize(
    ("topic", "sample", "mode", "says"),
    [
        pytest.param(  # from there on stamps go back
            *(topics.GROUND_TRUTH, FUTURE, (), "it holds 2 runs"), marks=pytest.mark.one_in(8)
        ),
        (topics.JOINT_STATES, FUTURE, (), AGAIN),
        # Nobody uses a push: in lock-step it cannot be told from others, in real time it names no source.
        (f"/{topics.OPERATOR_PUSH}", PUSH, LOCKSTEP, "operator/push"),
        (f"/{topics.OPERATOR_PUSH}", PUSH, (), ""),
    ],
    ids=["true state", "measured state", "push in lock-step", "push"],
)
def test_a_stranger_publishes_before_the_run(
    children: Children,
    peer: Peer,
    tmp_path: Path,
    topic: str,
    sample: JointSample,
    mode: tuple[str, ...],
    says: str,
) -> None:
    held = ("--set", "simulator.autostart=false")  # until the stranger has spoken
    run = children.trunk("run", "demo", "--duration", 1, "--output", "run", *mode, *held)
    assert Services(peer, "simulator").change("configure")
    stranger = peer.publisher(topic, "recorder")
    peer.until_event("recorder", Event.READY)
    stranger.publish(sample_to_ros(sample))
    peer.until_received(stranger)
    assert Services(peer, "simulator").change("activate")
    assert run.wait() == int(bool(says)), run.stderr
    children.none_left()
    found = Recording.open(tmp_path / "run" / "run.mcap")
    assert found.complete == (not says)
    if says:
        assert run.stdout.startswith("INCOMPLETE: ")
        assert re.search(says, run.stdout)
        assert verify(found).exit_code in ({UNJUDGED} if mode else {UNJUDGED, DIVERGES})
