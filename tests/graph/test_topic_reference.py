"""A reference from a topic holds as long as the profile is ``topic``, and not a state longer."""

from collections.abc import Callable
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_evidence.judgement import VERIFIED, verify
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Children
from .services import Services

pytestmark = [pytest.mark.graph, pytest.mark.virtual]

PERIOD_NS = 5_000_000


@pytest.fixture
def command(children: Children, peer: Peer) -> Callable[[], float]:
    """Show a P controller of 60 N m/rad the upright trunk once more, and return its command."""
    gains = ("gains.p:=60.0", "gains.i:=0.0", "gains.d:=0.0")
    node = children.node(
        "pid", *gains, "reference.profile:=topic", "reference.value:=0.1", "update_rate:=200.0"
    )
    peer.until_up("pid")
    show = peer.speaker(topics.JOINT_STATES)
    heard = peer.hear(topics.EFFORT_COMMAND)
    stamps = iter(range(0, 10**12, PERIOD_NS))

    def answer() -> float:
        stamp_ns = next(stamps)
        upright = JointSample(stamp_ns, ("hip", "trunk"), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
        show(upright)
        peer.until(
            lambda: heard and stamp_from_ros(heard[-1].header.stamp) == stamp_ns,
            f"an answer to {stamp_ns} ns",
        )
        return heard[-1].effort[0]

    yield answer
    assert node.stop() == 0


def test_it_ends_with_its_profile(command: Callable[[], float], peer: Peer) -> None:
    def take_profile(name: str) -> None:
        result = Services(peer, "pid").set(reference__profile=name)
        assert result.successful, result.reason

    tell = peer.speaker(topics.REFERENCE)

    def told(angle: float) -> None:
        tell(JointSample(0, ("trunk",), position=(angle,)))
        peer.until(lambda: command() == 60.0 * angle, f"the reference of {angle} rad acts")

    before_any = 60.0 * 0.1
    assert command() == before_any
    told(0.5)
    take_profile("constant")
    assert command() == before_any
    assert peer.call(Trigger, "/pid/reset").success
    assert command() == before_any
    take_profile("topic")
    assert command() == before_any
    told(0.25)


def test_a_reference_for_this_controller_alone(command: Callable[[], float], peer: Peer) -> None:
    to_all, to_pid = peer.speaker(topics.REFERENCE), peer.speaker("pid/reference")
    to_another = peer.node.create_publisher(JointState, "lqr/reference", 1)
    for tell, angle in ((to_pid, 0.5), (to_all, 0.25), (to_pid, 0.125)):
        to_another.publish(JointState(name=["trunk"], position=[1.0]))
        tell(JointSample(0, ("trunk",), position=(angle,)))
        peer.until(lambda: command() == 60.0 * angle, f"{angle} rad acts")  # noqa: B023


@pytest.mark.usefixtures("patient")
def test_it_is_recorded_and_judged(children: Children, peer: Peer, tmp_path: Path) -> None:
    recorder = children.node("recorder", "output:=run.mcap", "lockstep.enabled:=true")
    peer.until_event("recorder", Event.ACTIVATED)
    names = ("-r", "__node:=balance", "lockstep.enabled:=true", "reference.profile:=topic")
    controller = children.node("pid", *names)
    peer.until_event("balance", Event.ACTIVATED)
    records = peer.hear_live("balance/controller_state")
    wait_for = "wait_for:=[effort_command, recorder]"
    simulator = children.node("simulator", "lockstep.enabled:=true", "duration:=0.0", wait_for)
    tell = peer.node.create_publisher(JointState, "balance/reference", 10)
    peer.until(lambda: tell.get_subscription_count() == 2, "controller and recorder listen")
    tell.publish(JointState(name=["trunk"], position=[0.2]))

    def last() -> dict[str, float]:
        return dict(zip(records[-1].name, records[-1].position, strict=True)) if records else {}

    peer.until(lambda: last().get("reference") == 0.2, "it acts")
    peer.until_received(tell)
    assert [one.stop() for one in (simulator, controller, recorder)] == [0, 0, 0], recorder.stderr
    recording = Recording.open(tmp_path / "run.mcap")
    told = recording.joints("/balance/reference").column("position", "trunk")
    assert told.tolist() == [0.2]
    assert recording.complete, recording.warnings
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict
    assert "commands of pid" in {part.name for part in verdict.checks}
