"""What acted on the plant in each state is on record, with who sent it; seeds hold it of any run."""

import signal
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import ENDS
from trunk_msgs_util.node.conversions import sample_to_ros, stamp_from_ros
from trunk_msgs_util.source import process_id
from trunk_recording.joint_table import JointTable
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Child, Children
from .recordings import joints

pytestmark = [pytest.mark.graph, pytest.mark.virtual, pytest.mark.usefixtures("patient")]

ALL = f"wait_for:=[{topics.EFFORT_COMMAND}, {topics.DISTURBANCE}, recorder]"
# The first state waits for its disturbance, which is pushed.
PUSHES = (
    "pulse.channel:=trunk_effort",
    "pulse.start_times:=[0.0]",
    "pulse.duration:=0.5",
    "pulse.magnitude:=2.0",
)
COMMAND, DISTURBANCE = slice(0, 1), slice(1, 5)  # columns of a row


def sources(arrays: JointTable) -> list[str]:
    return [arrays.frames[place] for place in arrays.frame.tolist()]


def recorded(folder: Path, *nodes: Child) -> Recording:
    """Stop the nodes, the recorder last, and return the recording, in which each state has one row."""
    codes = {node.name: node.stop() for node in nodes}
    found = Recording.open(folder / "run.mcap")
    assert codes.pop("recorder") == (not found.complete)
    assert not any(codes.values()), codes
    rows, states = joints(found, topics.PLANT_INPUTS), joints(found, topics.GROUND_TRUTH)
    assert rows.names == topics.INPUT_NAMES
    assert rows.stamp_ns.tolist() == states.stamp_ns.tolist()
    assert rows.position.shape == rows.velocity.shape == (len(states), 5)
    assert rows.effort.shape == (len(states), 0)
    return found


def acted(found: Recording, columns: slice) -> dict[int, tuple[str, int, tuple[float, ...]]]:
    """Return source, stamp and values of the command or the disturbance in force, by the state's stamp.

    Each of them is on record, or nothing is in force.
    """
    topic = topics.EFFORT_COMMAND if columns == COMMAND else topics.DISTURBANCE
    there = joints(found, topic)
    values = there.effort if columns == COMMAND else np.hstack([there.effort, there.position])
    sent = {
        (source if "@" in source else "-", stamp, tuple(v))
        for source, stamp, v in zip(
            sources(there), there.stamp_ns.tolist(), values.tolist(), strict=True
        )
    }
    rows, in_force = joints(found, topics.PLANT_INPUTS), {}
    for k, frame in enumerate(sources(rows)):
        simulator, *senders = frame.split(" ")
        source = senders[columns != COMMAND]
        ages, acting = rows.velocity[k, columns], tuple(rows.position[k, columns].tolist())
        assert "@" in simulator
        assert (ages == ages[0]).all()
        stamp_ns = int(rows.stamp_ns[k])
        if ages[0] < 0.0:
            assert (source, set(ages), set(acting)) == ("-", {-1.0}, {0.0})
            continue
        key = source, stamp_ns - int(ages[0]), acting
        assert key in sent
        in_force[stamp_ns] = key
    return in_force


def torques_follow(
    found: Recording, in_force: dict[int, tuple[str, int, tuple[float, ...]]]
) -> None:
    """The true states have the torque over the step before them: that of the command in the row."""
    truth = joints(found, topics.GROUND_TRUTH)
    stamps = truth.stamp_ns.tolist()
    for before, torque in zip(stamps, truth.column("effort", "trunk")[1:].tolist(), strict=False):
        assert torque == (in_force[before][2][0] if before in in_force else 0.0)


def test_a_run_in_real_time_has_all_that_acted(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid, disturbance = children.node("pid"), children.node("disturbance", *PUSHES)
    simulator = children.node("simulator", "duration:=1.0", ALL)
    assert simulator.wait() == 0, simulator.stderr
    source = {
        name: f"{name}@{process_id(child.process.pid)}"
        for name, child in (("pid", pid), ("disturbance", disturbance), ("recorder", recorder))
    }
    found = recorded(tmp_path, pid, disturbance, recorder)
    assert found.complete, found.warnings
    commands, pushes = acted(found, COMMAND), acted(found, DISTURBANCE)
    assert {source for source, *_ in commands.values()} == {source["pid"]}
    assert {source for source, *_ in pushes.values()} == {source["disturbance"]}
    assert pushes[0] == (source["disturbance"], 0, (0.0, 2.0, 0.0, 0.0))
    assert {values[1] for *_, values in pushes.values()} <= {0.0, 2.0}
    torques_follow(found, commands)
    counts = [
        e.values
        for e in found.events("/run/events")
        if e.message == "published" and "simulator" in e.node
    ]
    assert counts[0]["/plant/inputs"] == counts[0]["/joint_states"] == "201"
    # Everything that is recorded names its source.
    (plant,) = {
        e.source
        for e in found.events("/run/events")
        if e.node == "/simulator" and e.message == "started"
    }
    assert plant.startswith("simulator@")
    for topic, sender in (
        (topics.GROUND_TRUTH, plant),
        (topics.JOINT_STATES, plant),
        (topics.EFFORT_COMMAND, source["pid"]),
        (topics.DISTURBANCE, source["disturbance"]),
        (topics.controller_state("pid"), source["pid"]),
    ):
        assert joints(found, topic).frames == (sender,), topic
    for message in (*found.events("/run/events"), *found.parameter_messages("/run/parameters")):
        name = message.node.lstrip("/")
        known = {**source, "simulator": plant}[name]
        # The disturbance learns from the first state that it is in real time.
        early = name == "disturbance" and message.stamp_ns <= 0
        assert message.source == known or (early and not message.source), message


def test_a_strangers_command_is_named_by_its_stamp_alone(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    recorder = children.node("recorder", "output:=run.mcap")
    command = peer.node.create_publisher(JointState, topics.EFFORT_COMMAND, 10)
    peer.until(command.get_subscription_count, "the recorder listens")
    answered = []

    def on_state(state: JointState) -> None:
        answer = sample_to_ros(
            JointSample(stamp_from_ros(state.header.stamp), ("trunk",), effort=(-0.125,))
        )
        answer.header.frame_id = "base_link"
        command.publish(answer)
        answered.append(answer)

    peer.node.create_subscription(JointState, topics.JOINT_STATES, on_state, 10)
    waits = f"wait_for:=[{topics.EFFORT_COMMAND}, recorder]"
    simulator = children.node("simulator", "duration:=0.0", waits)
    peer.until(lambda: len(answered) > 100, "it is commanded")
    assert simulator.stop() == 0, simulator.stderr
    peer.until_received(command)
    found = recorded(tmp_path, recorder)
    assert found.complete, found.warnings
    in_force = acted(found, COMMAND)
    assert {source for source, *_ in in_force.values()} == {"-"}
    assert {values for *_, values in in_force.values()} == {(-0.125,)}
    assert not acted(found, DISTURBANCE)
    torques_follow(found, in_force)


@pytest.mark.parametrize(
    ("word", "settings"),
    [
        ("stopped", ("duration:=3600.0",)),
        ("failed", ("duration:=3600.0", "command_timeout:=3600.0")),
    ],
    ids=["stopped", "diverged"],
)
def test_however_a_run_ends_its_last_state_has_a_row(
    children: Children, peer: Peer, tmp_path: Path, word: str, settings: tuple[str, ...]
) -> None:
    recorder = children.node("recorder", "output:=run.mcap")
    simulator = children.node("simulator", *settings, "wait_for:=[recorder]")
    peer.until_event("simulator", "started")
    if word == "stopped":
        peer.until_recorded(200)
        simulator.send(signal.SIGINT)
    elif word == "failed":
        command = peer.publisher(topics.EFFORT_COMMAND, "simulator", "recorder")
        command.publish(sample_to_ros(JointSample(0, ("trunk",), effort=(1e300,))))
        peer.until_received(command)
    assert simulator.wait() == 1, simulator.stderr
    found = recorded(tmp_path, recorder)
    (end,) = (e for e in found.events("/run/events") if e.message in ENDS)
    assert end.message == word
    assert len(joints(found, topics.PLANT_INPUTS)) == int(end.values["states"])
    in_force = acted(found, COMMAND)
    if word == "failed":
        last = max(in_force)
        assert last == joints(found, topics.GROUND_TRUTH).stamp_ns[-1]
        assert in_force[last] == ("-", 0, (1e300,))
