"""Commands and states that must not be applied: counted in /diagnostics, with no effect.

The test is the only controller, so it decides to the bit what acts on the plant.
"""

import signal
from math import inf, nan

import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import sample_to_ros, stamp_from_ros

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph

PERIOD_NS = 5_000_000
TIMEOUT_NS = 300_000_000  # of commands
GOOD, BAD = 0.25, 77.0  # N m


def command(stamp_ns: int, effort: float = BAD, name: str = "trunk") -> JointSample:
    return JointSample(stamp_ns, (name,), effort=(effort,))


def stamp_of(messages: list[JointState]) -> int:
    """Return the last message's stamp, -1 if there is none."""
    return stamp_from_ros(messages[-1].header.stamp) if messages else -1


def efforts(truth: list[JointState]) -> dict[int, float]:
    """Return the torque over the step before each state, by the state's stamp."""
    return {stamp_from_ros(m.header.stamp): m.effort[1] for m in truth}


@pytest.mark.virtual
def test_real_time(children: Children, peer: Peer) -> None:
    truth = peer.hear(topics.GROUND_TRUTH)
    simulator = children.node("simulator", f"command_timeout:={TIMEOUT_NS / 1e9}")
    say = peer.speaker(topics.EFFORT_COMMAND)
    peer.until_event("simulator", "started")
    peer.until(lambda: len(truth) > 10, "states go on")
    # However late the commands are on a busy machine, simulated time waits for them.
    assert peer.call(SetBool, "/simulator/pause", data=True).success
    good_ns = peer.until_event("simulator", "paused").stamp_ns
    for bad in (
        command(good_ns, name="hip"),
        JointSample(good_ns, ("trunk",)),  # no effort in it
        command(good_ns, nan),
        command(good_ns, inf),
        command(
            good_ns + 3600 * 10**9
        ),  # answers a state that does not exist: acts, until an answer comes
    ):
        say(bad)
    say(command(good_ns, GOOD))
    say(command(good_ns))  # again
    say(command(good_ns - PERIOD_NS))  # stale
    said = peer.fresh_diagnostics("simulator")
    while said.get("commands out of order") != "1":
        said = peer.fresh_diagnostics("simulator")
    assert said["repeated answers ignored"] == "1"
    assert said["commands with no state's stamp"] == "1"
    assert said["commands without the joint"] == "1"
    assert said["commands without an effort"] == "1"
    assert said["commands not finite"] == "2"
    assert peer.call(SetBool, "/simulator/pause", data=False).success
    peer.until(lambda: GOOD in efforts(truth).values(), "the good command is used")
    peer.until(lambda: efforts(truth[-1:]).popitem()[1] == 0.0, "it is used no longer")
    assert simulator.stop() == 0, simulator.stderr
    measured_torque = efforts(truth)
    assert set(measured_torque.values()) == {0.0, GOOD}
    # The last step that used it begins exactly the timeout after the state that it answers.
    used = [stamp_ns for stamp_ns, effort in measured_torque.items() if effort == GOOD]
    assert used == list(range(used[0], good_ns + TIMEOUT_NS + 2 * PERIOD_NS, PERIOD_NS))


@pytest.mark.virtual
def test_lockstep(children: Children, peer: Peer) -> None:
    truth = peer.hear(topics.GROUND_TRUTH)
    patient = ("lockstep.enabled:=true", "lockstep.timeout:=3600.0")
    simulator = children.node("simulator", *patient, "duration:=0.025")
    say = peer.speaker(topics.EFFORT_COMMAND)
    peer.until_event("simulator", "started")
    for k in range(5):
        now_ns = k * PERIOD_NS
        peer.until(lambda: stamp_of(truth) == now_ns, "the plant steps")  # noqa: B023
        say(command(now_ns - PERIOD_NS))  # for k = 0: a negative stamp
        say(command(now_ns + PERIOD_NS))
        say(command(now_ns, nan))
        say(command(now_ns, BAD, "hip"))
        say(command(now_ns, GOOD + k))
        say(command(now_ns))
    peer.until(lambda: stamp_of(truth) == 5 * PERIOD_NS, "the plant steps")
    said = peer.fresh_diagnostics("simulator")
    assert said["commands without the joint"] == said["commands not finite"] == "5"
    assert said["answers to no state ignored"] == "5"
    assert said["late answers ignored"] == "10"
    say(command(5 * PERIOD_NS, GOOD))  # the last state needs an answer too
    assert simulator.wait() == 0, simulator.stderr
    assert list(efforts(truth).values()) == [0.0] + [GOOD + k for k in range(5)]


@pytest.mark.virtual
def test_silent_nodes_in_real_time(children: Children, peer: Peer) -> None:
    truth = peer.hear(topics.GROUND_TRUTH)
    nodes = [children.node("pid"), children.node("disturbance")]
    waits = f"wait_for:=[{topics.EFFORT_COMMAND}, {topics.DISTURBANCE}]"
    simulator = children.node("simulator", f"command_timeout:={TIMEOUT_NS / 1e9}", waits)
    peer.until(lambda: len(truth) > 50 and truth[-1].effort[1] != 0.0, "commands are used")
    for node in nodes:
        node.send(signal.SIGSTOP)
    peer.until(lambda: not any(m.effort[1] for m in truth[-20:]), "the torque goes to zero")
    for node in nodes:
        node.send(signal.SIGCONT)
    peer.until(lambda: truth[-1].effort[1] != 0.0, "commands are used again")
    said = peer.fresh_diagnostics("simulator")
    for kind in ("command", "disturbance"):
        assert int(said[f"steps without a fresh {kind}"]) >= 10
    for child in (simulator, *nodes):
        assert child.stop() == 0, child.stderr


def test_bad_states_and_strangers(children: Children, peer: Peer) -> None:
    """The test plays the plant: a controller counts what it cannot use and answers the rest."""
    answers = peer.hear(topics.EFFORT_COMMAND)
    # A megabyte fills the kernel's buffer: in real time, what does not fit is not sent again.
    reliable = f"qos_overrides./{topics.JOINT_STATES}.subscription.reliability:=reliable"
    pid = children.node("pid", "gains.i:=0.0", "gains.d:=0.0", reliable)
    say = peer.speaker(topics.JOINT_STATES)

    def state(k: int, angle: float = 0.25) -> JointSample:
        return JointSample(k * PERIOD_NS, ("hip", "trunk"), (0.0, angle), (0.0, 0.0))

    say(state(0))
    for bad in (
        state(1, nan),
        state(2, inf),
        JointSample(3 * PERIOD_NS, ("hip", "pelvis"), (0.0, 0.25), (0.0, 0.0)),
        JointSample(4 * PERIOD_NS, (), (), ()),
        JointSample(5 * PERIOD_NS, ("hip", "trunk"), (0.0,), (0.0,)),
        JointSample(6 * PERIOD_NS, ("hip", "trunk"), (0.0, 0.25)),
    ):
        say(bad)
    wide = tuple(f"joint_{i}" for i in range(20_000))  # a megabyte
    say(JointSample(7 * PERIOD_NS, (*wide, "trunk"), (0.0,) * 20_000 + (0.5,), (0.0,) * 20_001))

    def answered() -> dict[int, float]:
        return {stamp_from_ros(m.header.stamp): m.effort[0] for m in answers}

    peer.until(lambda: 7 * PERIOD_NS in answered(), "the joint is found among many")
    for k in range(8, 1008):  # a flood, deeper than any queue of the loop
        say(state(k))
    say(state(3, 0.125))  # time goes back: the controller starts afresh
    peer.until(lambda: answered().get(3 * PERIOD_NS), "the last state is answered")
    heard = answered()
    assert heard[7 * PERIOD_NS] == -0.5 * 60.0
    assert not {1, 2, 4, 5, 6} & {stamp_ns // PERIOD_NS for stamp_ns in heard}
    assert heard[3 * PERIOD_NS] == -0.125 * 60.0
    said = peer.fresh_diagnostics("pid")
    assert said["states not finite"] == "2"
    assert said["states without the joint"] == "3"
    assert said["states without the velocity that the law needs"] == "1"
    assert said["states out of order"] == "1"
    best_effort = peer.node.create_publisher(JointState, topics.JOINT_STATES, qos.view())

    def heard_best_effort() -> bool:
        best_effort.publish(sample_to_ros(state(2000)))
        return 2000 * PERIOD_NS in answered()

    peer.until(heard_best_effort, "a best-effort publisher is heard, too")
    gaps = "gaps in the states, started afresh after them"
    before = int(said.get(gaps, 0))  # of the flood, states may be lost
    assert int(peer.fresh_diagnostics("pid")[gaps]) == before + 1

    assert pid.stop() == 0
    assert "Traceback" not in pid.stderr
