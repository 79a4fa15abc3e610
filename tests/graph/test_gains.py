"""Fuzzy-PID's gains alone: the same bits as ``fuzzy_pid``; somebody else's PID holds the plant with them."""

import re
import signal
import sys
from pathlib import Path

import pytest
from std_msgs.msg import Float64MultiArray

from trunk_core import topics
from trunk_evidence.judgement import VERIFIED, verify
from trunk_msgs_util.node import qos
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Child, Children

pytestmark = pytest.mark.graph

EXAMPLES = Path(__file__).parents[2] / "examples"
PAGE = EXAMPLES / "ros2_control" / "README.md"
LOCKSTEP = "lockstep.enabled:=true"


@pytest.fixture
def gains_node(children: Children, peer: Peer) -> Child:
    """The node, once it is there for the simulator to find."""
    node = children.start("gains", sys.executable, EXAMPLES / "nodes" / "fuzzy_gains.py")
    peer.until(lambda: peer.node.count_publishers("fuzzy_gains/gains"), "the node is up")
    return node


def gains_heard(peer: Peer) -> list[Float64MultiArray]:
    heard: list[Float64MultiArray] = []
    topic = "fuzzy_gains/gains"
    subscription = peer.node.create_subscription(Float64MultiArray, topic, heard.append, qos.live())
    peer.until(subscription.get_publisher_count, "the gains can be heard")
    return heard


@pytest.mark.usefixtures("patient")
def test_same_bits_as_the_controller(
    children: Children, peer: Peer, tmp_path: Path, gains_node: Child
) -> None:
    heard = gains_heard(peer)
    recorder = children.node("recorder", "output:=run.mcap", LOCKSTEP)
    controller = children.node("fuzzy_pid", LOCKSTEP)
    for node in ("recorder", "fuzzy_pid"):
        peer.until_up(node)
    given = ("initial.position:=[0.0, 0.3]", "duration:=0.0")
    simulator = children.node("simulator", LOCKSTEP, *given, "wait_for:=[effort_command, recorder]")
    # Nothing waits for the node of the gains: it may begin late.
    peer.until(lambda: len(heard) > 100, "gains come")
    assert simulator.stop() == 0, simulator.stderr
    assert [one.stop() for one in (controller, recorder)] == [0, 0]
    recording = Recording.open(tmp_path / "run.mcap")
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    terms = recording.joints("/fuzzy_pid/state")
    columns = (terms.column("position", name).tolist() for name in ("kp", "ki", "kd"))
    wanted = list(zip(*columns, strict=True))
    assert len(set(wanted)) > 100
    # On a busy machine it may miss states.
    left = iter(wanted)
    assert all(tuple(one.data) in left for one in heard)
    assert gains_node.stop() == 0, gains_node.stderr


def test_the_pid_of_the_page_holds_the_trunk(
    children: Children, peer: Peer, gains_node: Child
) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    heard = gains_heard(peer)
    # All states, since the stranger integrates over them: it may be matched sooner than this test.
    states, commands = peer.hear(topics.JOINT_STATES), peer.hear_live(topics.EFFORT_COMMAND)
    stranger = children.python(code, name="stranger")
    gains = "fuzzy_gains/gains"
    peer.until(lambda: peer.node.count_subscribers(gains) == 2, "the stranger asks for the gains")
    given = ("initial.position:=[0.0, 0.3]", "duration:=0.0", "lockstep.timeout:=3600.0")
    simulator = children.node("simulator", LOCKSTEP, *given, "wait_for:=[effort_command]")
    peer.until(lambda: len(states) > 1000 and len(heard) > 200, "five seconds have passed")
    after = len(states) + 200
    peer.until(lambda: len(states) > after, "one more")
    assert simulator.stop() == 0, simulator.stderr
    assert all(abs(state.position[1]) < 0.2 for state in states[-400:])  # it keeps walking
    assert gains_node.stop() == 0, gains_node.stderr

    assert stranger.stop(signal.SIGKILL) == -signal.SIGKILL
    told = {tuple(one.data) for one in heard}
    by_stamp = {(m.header.stamp.sec, m.header.stamp.nanosec): m.effort[0] for m in commands}
    by_gains, integral, before = 0, 0.0, 0.0
    for state in states:
        sec, nanosec = state.header.stamp.sec, state.header.stamp.nanosec
        (_, angle), (_, rate) = state.position, state.velocity
        now = sec + 1e-9 * nanosec
        integral, before = integral - angle * (now - before), now
        given = {-p * angle + i * integral - d * rate for p, i, d in told}
        by_gains += by_stamp.get((sec, nanosec)) in given
    assert by_gains


def test_a_parameter_that_is_not_allowed_is_one_line(children: Children) -> None:
    words = ("--ros-args", "-p", "gains.p_max:=-1.0")
    node = children.start("gains", sys.executable, EXAMPLES / "nodes" / "fuzzy_gains.py", *words)
    assert node.wait() == 1
    assert node.stderr.startswith("fuzzy_gains: parameter 'gains.p_max': -1.0 is not allowed")
    assert node.stderr.count("\n") == 1
