"""The recorder hears every publisher, whatever its name and quality of service, or says what it missed."""

import signal
from itertools import chain
from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import sample_to_ros, stamp_from_ros
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Child, Children, until
from .services import Services
from .verbs import said

pytestmark = pytest.mark.graph

COUNT = 100  # of each publisher
# Messages at a time: some 270 fill the kernel's buffer for a recorder; beyond that, best effort is lost.
LOT = 100
DEFAULT = QoSProfile(depth=10)
LAST = "/disturbance"
LOCKSTEP = "lockstep.enabled:=true"
TOPICS = (topics.EFFORT_COMMAND, topics.REFERENCE, topics.DISTURBANCE, topics.JOINT_STATES)


def recorded(recorder: Child, folder: Path) -> Recording:
    code = recorder.stop()
    recording = Recording.open(folder / "run.mcap")
    assert code in (0, int(not recording.complete)), recorder.stderr
    return recording


@pytest.mark.parametrize(
    "profiles",
    [
        [DEFAULT],
        pytest.param([qos_profile_sensor_data], marks=pytest.mark.one_in(8)),
        pytest.param(
            [DEFAULT, qos.evidence(), qos_profile_sensor_data], marks=pytest.mark.one_in(8)
        ),
    ],
    ids=["default", "best effort", "all three"],
)
@pytest.mark.parametrize(
    "equal", [pytest.param(False, marks=pytest.mark.one_in(8)), True], ids=["", "equal"]
)
def test_every_message_is_recorded_once(
    children: Children, peer: Peer, tmp_path: Path, profiles: list[QoSProfile], equal: bool
) -> None:
    """On each topic. ``equal``: all publishers give the same messages, and each one twice."""
    recorder = children.node("recorder", "output:=run.mcap")
    peer.until_event("recorder", Event.ACTIVATED)
    publishers = [
        [peer.node.create_publisher(JointState, topic, profile) for profile in profiles]
        for topic in TOPICS
    ]
    for publisher in chain(*publishers):
        peer.until(publisher.get_subscription_count, "the recorder listens")
    # Its own are recorded, too.
    heard = int(peer.fresh_diagnostics("recorder")["messages"])
    for k in range(COUNT):
        for several in publishers:
            for n, publisher in enumerate(several):
                stamp_ns, angle = (k // 2, 0.0) if equal else (k, float(n))
                publisher.publish(sample_to_ros(JointSample(stamp_ns, ("trunk",), (angle,))))
                heard += 1
        if (k + 1) % (LOT // (len(TOPICS) * len(profiles))) == 0:
            peer.until_recorded(heard)
    recording = recorded(recorder, tmp_path)
    told = [k // 2 if equal else k for k in range(COUNT)]
    for topic in TOPICS:
        stamps = recording.joints(f"/{topic}").stamp_ns.tolist()
        assert sorted(stamps) == sorted(told * len(profiles)), topic


@pytest.mark.virtual
@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    "profile",
    # Deep: a recorder that is held up still gets all of them.
    [QoSProfile(depth=qos.EVIDENCE_DEPTH), qos.evidence()],
    ids=["volatile", "latched"],
)
def test_another_node_that_repeats_our_messages_adds_none(
    children: Children, peer: Peer, tmp_path: Path, profile: QoSProfile
) -> None:
    """Each copy has the bytes of the original, with its source, and, from the first one on, its number."""
    copies: list[JointState] = []
    publisher = peer.node.create_publisher(JointState, topics.DISTURBANCE, profile)

    def repeat(message: JointState) -> None:
        publisher.publish(message)
        copies.append(message)

    recorder = children.node("recorder", "output:=run.mcap")
    peer.until(publisher.get_subscription_count, "the recorder listens")
    kept = topics.evidence(topics.DISTURBANCE)
    peer.node.create_subscription(JointState, kept, repeat, qos.evidence())
    simulator = children.node(
        "simulator", "duration:=0.0", "wait_for:=[disturbance]", "autostart:=false"
    )
    # To the simulator, any publisher of disturbances will do: it begins once the node is there too.
    life = Services(peer, "simulator")
    assert life.change("configure")
    disturbance = children.node("disturbance")
    peer.until_event("disturbance", Event.READY)
    assert life.change("activate")
    peer.until(lambda: len(copies) > 200, "it is repeated")
    assert [simulator.stop(), disturbance.stop()] == [0, 0]
    (told,) = peer.until(
        lambda: [e.values for e in peer.events if (e.node, e.message) == (LAST, "published")],
        "the disturbance says how much it has published",
    )
    own = int(told[f"/{topics.DISTURBANCE}"])
    peer.until(lambda: len(copies) == own, "everything is repeated")
    peer.until_received(publisher)
    found = recorded(recorder, tmp_path)
    assert found.topics[f"/{topics.DISTURBANCE}"].count == own
    assert found.complete, found.warnings


@pytest.mark.virtual
def test_a_controller_of_ten_lines_is_recorded_in_lockstep(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """With rclpy's default quality of service; the plant waits for it and for the recorder."""
    recorder = children.node("recorder", "output:=run.mcap", "lockstep.enabled:=true")
    command = peer.node.create_publisher(JointState, topics.EFFORT_COMMAND, 10)
    # This publisher keeps no past: the plant would wait for what the recorder has missed.
    peer.until(command.get_subscription_count, "the recorder listens to commands")

    def on_state(state: JointState) -> None:
        answer = JointState(header=state.header, name=["trunk"])
        answer.effort = [-200.0 * state.position[1] - 20.0 * state.velocity[1]]
        command.publish(answer)
        answered[0] += 1

    answered = [0]
    peer.node.create_subscription(JointState, topics.JOINT_STATES, on_state, 10)
    simulator = children.node(
        "simulator",
        "lockstep.enabled:=true",
        "lockstep.timeout:=3600.0",
        "duration:=1.0",
        "wait_for:=[effort_command, recorder]",
    )
    peer.until(lambda: answered[0] > 50, "the run goes on")
    recorder.send(signal.SIGSTOP)  # what is published is kept ten messages deep
    for _ in range(100):
        peer.spin(0.02)
    recorder.send(signal.SIGCONT)
    peer.until(lambda: simulator.process.poll() is not None, "the run ends")
    assert simulator.wait() == 0, simulator.stderr
    found = recorded(recorder, tmp_path)
    assert found.complete, found.warnings
    counts = [
        found.topics[f"/{topic}"].count
        for topic in (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND)
    ]
    assert counts == [201, 201, 201]


@pytest.mark.virtual
@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    ("topic", "mode", "spoils"),
    [
        (topics.own_reference("pid"), (), False),
        (topics.EFFORT_COMMAND, (), False),
        (topics.REFERENCE, (LOCKSTEP,), False),
        (topics.EFFORT_COMMAND, (LOCKSTEP,), True),
    ],
)
def test_a_publisher_of_another_type_is_named(
    children: Children, peer: Peer, tmp_path: Path, topic: str, mode: tuple[str, ...], spoils: bool
) -> None:
    """Nobody receives it; in lock-step, on a topic of the loop, a node is then missing in the run."""
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]", *mode)
    peer.node.create_publisher(Float64, topic, 10)
    named = f"{topic}: /peer publishes std_msgs/msg/Float64 there, not sensor_msgs/msg/JointState"
    until(lambda: f"nobody receives it: {named}" in recorder.stderr, "it is named")
    pid = children.node("pid", *mode)
    simulator = children.node("simulator", "duration:=0.0", "wait_for:=[effort_command]", *mode)
    peer.until_recorded(200)
    assert [simulator.stop(), pid.stop()] == [0, 0]
    assert recorded(recorder, tmp_path).warnings == ([f"incomplete: {named}"] if spoils else [])


@pytest.mark.virtual
def test_a_late_viewer_of_a_live_topic_sees_only_the_present(
    children: Children, peer: Peer
) -> None:
    """Tools request the QoS that is offered: the past only where it is kept, on no topic they look at."""
    simulator = children.node("simulator", "duration:=0.0", "wait_for:=[]")
    kept = peer.hear(topics.GROUND_TRUTH)
    peer.until(lambda: len(kept) > 100, "half a second is past")
    peer.until(lambda: peer.node.count_publishers(topics.GROUND_TRUTH), "its publisher is found")
    offered = peer.node.get_publishers_info_by_topic(topics.GROUND_TRUTH)
    assert [found.qos_profile.durability for found in offered] == [DurabilityPolicy.VOLATILE]
    seen = peer.hear_live(topics.GROUND_TRUTH)
    peer.until(lambda: seen, "a state comes")
    assert stamp_from_ros(seen[0].header.stamp) >= stamp_from_ros(kept[100].header.stamp)
    assert simulator.stop() == 0, simulator.stderr


@pytest.mark.virtual
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
    assert RecordedRun(recording).controllers == ("pid",)  # goes by what it is
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    assert verdict.checks[0].name == "commands of pid"
    assert "pid is the node /balance" in verdict.notes
    said("explain", tmp_path / "run.mcap", "--at", 0.1)


@pytest.mark.virtual
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
