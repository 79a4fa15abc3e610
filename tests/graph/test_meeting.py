"""A run begins when each node that answers is matched both ways; its clock comes before its states."""

from collections.abc import Iterator

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_recording.schemas import event

from .peer import Peer
from .processes import Children, until

pytestmark = [pytest.mark.graph, pytest.mark.virtual]


@pytest.fixture
def witness(domain: int) -> Iterator[Peer]:
    """Another node that only subscribes, such as a recorder."""
    listener = Peer("witness")
    yield listener
    listener.close()


@pytest.mark.parametrize(
    ("node", "hears", "answers"),
    [
        ("disturbance", topics.GROUND_TRUTH, topics.DISTURBANCE),
        ("pid", topics.JOINT_STATES, topics.EFFORT_COMMAND),
    ],
)
def test_a_node_is_ready_when_the_plant_receives_its_answers(
    children: Children, peer: Peer, witness: Peer, node: str, hears: str, answers: str
) -> None:
    child = children.node(node)
    witness.hear_live(answers)
    peer.speaker(hears)  # a plant that has not discovered the node's answers yet
    witness.until(lambda: witness.node.count_publishers(answers), "the witness has found the node")
    peer.fresh_diagnostics(node)
    peer.fresh_diagnostics(node)
    assert "ready" not in [event.message for event in peer.events]
    peer.hear_live(answers)
    peer.until_event(node, "ready")
    assert child.stop() == 0, child.stderr


@pytest.mark.parametrize(
    ("states", "answers"),
    [
        (topics.GROUND_TRUTH, topics.DISTURBANCE),
        (topics.JOINT_STATES, topics.EFFORT_COMMAND),
    ],
)
def test_the_plant_begins_when_it_has_discovered_the_ready_node(
    children: Children, peer: Peer, witness: Peer, states: str, answers: str
) -> None:
    seen = witness.hear_live(states)
    simulator = children.node("simulator", f"wait_for:=[{answers}]")
    # In this order: a publisher of answers that for a second is not known to be ready passes for a stranger.
    say = peer.node.create_publisher(DiagnosticArray, topics.RUN_EVENTS, qos.run_information())
    peer.until(say.get_subscription_count, "the simulator hears events")
    say.publish(event(0, "/peer", "ready", {"answers": answers}))
    peer.until_received(say)
    peer.node.create_publisher(JointState, answers, qos.evidence())
    peer.fresh_diagnostics("simulator")
    witness.fresh_diagnostics("simulator")
    assert not seen
    heard = peer.hear_live(states)
    witness.until(lambda: seen, "the run begins")
    peer.until(lambda: heard, "the peer hears it too")
    assert simulator.stop() == 0, simulator.stderr


def test_a_node_that_hears_nothing_says_what_it_waits_for(children: Children, domain: int) -> None:
    nodes = [children.node("recorder", "output:=run.mcap"), children.node("pid")]
    told = (
        "waiting for states on /joint_states: "
        "nobody publishes them (start it: ros2 run trunk_sim simulator)"
    )
    for node in nodes:
        until(lambda node=node: node.stderr.count(told) > 1, "it says so again")  # type: ignore[misc]
    simulator = children.node("simulator", "duration:=0.5")
    assert simulator.wait() == 0, simulator.stderr
    recorder, controller = nodes
    last = "the last one was at t = 0.5 s, and nobody publishes them now"
    until(lambda: last in controller.stderr, "the controller says that the states have ended")
    until(lambda: "waiting for Ctrl-C: the run is over" in recorder.stderr, "and the recorder")
    for node in (controller, recorder):
        assert node.stop() == 0, node.stderr


def test_a_waiting_plant_names_the_nodes_and_how_to_start_them(
    children: Children, domain: int
) -> None:
    simulator = children.node(
        "simulator", "wait_for:=[effort_command, disturbance, recorder]", "controllers:=[lqr]"
    )
    until(lambda: simulator.stderr.count("waiting for") > 1, "it says so again")
    told = simulator.stderr.splitlines()[0]
    assert told.endswith(
        "waiting for a controller (such as ros2 run trunk_control fuzzy_pid), "
        "the disturbance (ros2 run trunk_sim disturbance), "
        "the recorder (ros2 run trunk_msgs_util recorder), lqr"
    )
    assert simulator.stop() == 0, simulator.stderr


def test_a_waiting_plant_names_a_controller_that_is_there_but_inactive(
    children: Children, domain: int
) -> None:
    controller = children.node("pid", "active.times:=[0.0]")
    simulator = children.node("simulator")
    told = (
        "waiting for a controller that acts (inactive: /pid; activate one, or, for turns by active.times, "
        "start the simulator with controllers:=[pid])"
    )
    until(lambda: simulator.stderr.count(told) > 1, "it says so again")
    assert "seen instead" not in simulator.stderr.rpartition(told)[2]
    for node in (controller, simulator):
        assert node.stop() == 0, node.stderr


@pytest.mark.parametrize("topic", [topics.JOINT_STATES, topics.GROUND_TRUTH])
def test_the_clock_is_published_before_its_states(
    children: Children, peer: Peer, topic: str
) -> None:
    """By the middleware's write times: a node that has both waiting may still take a state first."""
    written: dict[str, dict[int, int]] = {"clock": {}, "state": {}}

    def on_clock(clock: Clock, info: dict[str, int]) -> None:
        written["clock"].setdefault(stamp_from_ros(clock.clock), info["source_timestamp"])

    def on_state(state: JointState, info: dict[str, int]) -> None:
        written["state"][stamp_from_ros(state.header.stamp)] = info["source_timestamp"]

    every = QoSProfile(depth=1000, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    peer.node.create_subscription(Clock, "/clock", on_clock, every)
    peer.node.create_subscription(JointState, topic, on_state, every)
    simulator = children.node("simulator", "publish_clock:=true", "wait_for:=[]")
    both = peer.until(
        lambda: len(found := written["clock"].keys() & written["state"].keys()) > 50 and found,
        "fifty states, and their clocks",
    )
    simulator.stop()
    # The first state's clock comes twice, and the peer may be too late for one of them.
    assert all(written["clock"][stamp] < written["state"][stamp] for stamp in both - {0})
