"""A robot that is not ours: balanced by our controller, recorded, its commands judged."""

import math
import random
import struct
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_evidence.judgement import UNJUDGED, verify
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Children
from .verbs import said

pytestmark = [pytest.mark.graph, pytest.mark.virtual]

PERIOD = 0.005  # s


class Robot:
    """An arm on a hinge: other joint names, stamps of a clock that jitters, no velocities, default QoS.

    Two broadcasters share the topic, and an instant's stamp.
    """

    def __init__(self, peer: Peer, unmeasured: dict[str, list[float]]) -> None:
        self.unmeasured = unmeasured
        self.angle, self.rate, self.torque = 0.2, 0.0, 0.0
        self.states = peer.node.create_publisher(JointState, topics.JOINT_STATES, 10)
        self.commands = 0
        self.now_ns, self.jitter = time.time_ns(), random.Random(1)
        self.answers = peer.node.create_subscription(
            JointState, topics.EFFORT_COMMAND, self._on_command, 10
        )

    def _on_command(self, command: JointState) -> None:
        self.torque = command.effort[list(command.name).index("arm")]
        self.commands += 1

    def step(self) -> None:
        self.rate += PERIOD * (20.0 * math.sin(self.angle) + self.torque) / 4.0
        self.angle += PERIOD * self.rate
        self.now_ns += round(PERIOD * 1e9)
        stamp_ns = self.now_ns + self.jitter.randint(-50_000, 50_000)
        for state in (
            JointState(name=["gripper"], position=[0.02]),
            JointState(name=["wheel", "arm"], position=[1.0, self.angle], **self.unmeasured),
        ):
            state.header.stamp.sec, state.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            self.states.publish(state)


NAN = [math.nan, math.nan]


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    "unmeasured", [{}, {"velocity": NAN, "effort": NAN}], ids=["left out", "not numbers"]
)
def test_commands_to_another_robot_are_judged(
    children: Children,
    peer: Peer,
    trunk: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    unmeasured: dict[str, list[float]],
) -> None:
    """A broadcaster leaves out what its hardware does not measure, or fills it with NaN."""
    robot = Robot(peer, unmeasured)
    recorder = children.node("recorder", "output:=run.mcap")
    peer.until(robot.states.get_subscription_count, "the recorder listens")
    gains = (
        "gains.p:=120.0",
        "gains.i:=0.0",
        "gains.d:=30.0",
        "derivative_mode:=error",
    )
    pid = children.node("pid", "joint:=arm", *gains)
    peer.until(lambda: robot.states.get_subscription_count() == 2, "the controller listens too")
    peer.until_event("pid", "ready")
    peer.until(robot.answers.get_publisher_count, "its commands will be heard")
    for k in range(400):
        if k % 4 == 0:
            peer.until_received(robot.states)  # they are kept ten messages deep
        before = robot.commands
        robot.step()
        peer.until(lambda: robot.commands > before, "the controller answers")  # noqa: B023
    assert abs(robot.angle) < 0.05, robot.angle
    peer.until_received(robot.states)
    peer.until_recorded(4 * 400)  # two messages, a command and its terms for each step
    assert peer.fresh_diagnostics("pid")["states skipped, no update due"] == "0"
    assert [pid.stop(), recorder.stop()] == [0, 0]

    path = tmp_path / "run.mcap"
    verdict = verify(Recording.open(path))
    assert verdict.exit_code == UNJUDGED
    (commands,) = verdict.checks
    assert (commands.name, commands.wrong_steps) == ("commands of pid", 0), commands
    assert commands.steps == 400
    assert "no simulator of ours: its states come from elsewhere" in verdict.obstacles

    def other_state(messages: list[list]) -> None:
        states = [m for m in messages if m[0] == "/joint_states" and b"wheel\0" in m[2]]
        data = bytearray(states[200][2])
        data[data.index(struct.pack("<d", 1.0)) + 12] ^= (
            1  # within the arm's angle, after the wheel's
        )
        states[200][2] = bytes(data)

    altered = verify(copied(path, tmp_path / "edited.mcap", other_state, digests=ANEW))
    assert any(part.wrong_steps for part in altered.checks)

    told = said("explain", path, "--at", 1.0)
    assert "recomputed: equal to the recorded command, bit for bit" in told
    assert "not known: another robot" in told
    said("plot", path, "-o", tmp_path / "run.svg")
    said("report", path, "-o", tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    assert "not judged" in page
    assert "400 from 0 s to 1.995 s" in page
    found = said("info", "--check", path, code=1)
    assert [line for line in found.splitlines() if line.startswith(("error", "warning"))] == [
        "error    incomplete: the recorder was stopped before the run was finished"
    ]
    assert trunk("metrics", path)[0] == 2


@pytest.mark.usefixtures("patient")
def test_a_jump_of_the_stamps_is_said_and_not_integrated(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    robot = Robot(peer, {})
    recorder = children.node("recorder", "output:=run.mcap")
    peer.until(robot.states.get_subscription_count, "the recorder listens")
    pid = children.node("pid", "joint:=arm", "derivative_mode:=error", "antiwindup_strategy:=none")
    peer.until(lambda: robot.states.get_subscription_count() == 2, "the controller listens too")
    peer.until_event("pid", "ready")
    peer.until(robot.answers.get_publisher_count, "its commands will be heard")
    for k in range(40):
        peer.until_received(robot.states)
        before = robot.commands
        robot.now_ns += 10**8 * 10**9 if k == 20 else 0
        robot.step()
        peer.until(lambda: robot.commands > before, "the controller answers")  # noqa: B023
        assert abs(robot.torque) < 100.0
    peer.until_received(robot.states)
    peer.until_recorded(4 * 40)
    assert [pid.stop(), recorder.stop()] == [0, 0]
    assert "no states for 1e+08 s up to t = " in pid.stderr
    verdict = verify(Recording.open(tmp_path / "run.mcap"))
    assert [(part.steps, part.wrong_steps) for part in verdict.checks] == [(40, 0)]
