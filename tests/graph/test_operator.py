"""A person pushes the running trunk: it moves, it is on the record, and it can be recomputed and repeated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.verdict import VERIFIED
from trunk_msgs_util import topics
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import stamp_from_ros, stamp_to_ros
from trunk_sim.operator_input import Applied

from .peer import Peer
from .processes import Child, Children

pytestmark = pytest.mark.graph

MOST = 80.0  # N m


class Hand:
    """An operator who sees the measured states and asks for torques."""

    def __init__(self, peer: Peer, name: str) -> None:
        self._peer, self._name = peer, name
        self._states = peer.hear_live("/joint_states")
        self._requests = peer.node.create_publisher(
            JointState, f"/{topics.OPERATOR_REQUEST}", qos.control()
        )

    def ready(self, listeners: int) -> None:
        """Wait until simulator and recorder hear."""
        self._peer.until(
            lambda: self._requests.get_subscription_count() >= listeners,
            "somebody hears the operator",
        )

    def now_ns(self) -> int:
        """Return the stamp of the latest state, once there is one."""
        self._peer.until(lambda: self._states, "a state")
        return stamp_from_ros(self._states[-1].header.stamp)

    def ask(self, torque: float, **header: object) -> None:
        message = JointState(name=["hip", "trunk"], effort=[0.0, torque])
        message.header.stamp = stamp_to_ros(self.now_ns())
        message.header.frame_id = self._name
        self._requests.publish(message)

    def hold(self, torque: float, until_ns: int) -> None:
        """Ask for a torque at each state that is seen, until a stamp."""
        while (now_ns := self.now_ns()) < until_ns:
            self.ask(torque)
            self._peer.until(lambda now_ns=now_ns: self.now_ns() > now_ns, "the next state")


@pytest.fixture
def pushed_run(
    children: Children, peer: Peer, tmp_path: Path
) -> Callable[..., tuple[Child, RecordedRun]]:
    """Return a function that runs while somebody does something, and gives the recording."""

    def run(do: Callable[[Hand], None], *given: object) -> tuple[Child, RecordedRun]:
        hand = Hand(peer, "somebody")
        child = children.trunk(
            *("run", "demo", "--duration", 3, "--output", "run"),
            *("--set", f"simulator.operator.torque={MOST}", *given),
        )
        peer.until_started(child)
        hand.ready(2)
        do(hand)
        assert child.wait() == 0, child.stderr
        return child, RecordedRun.open(tmp_path / "run" / "run.mcap")

    return run


LOCKSTEP = ("--lockstep", "--set", "simulator.lockstep.speed=1.0")


@pytest.mark.parametrize("mode", [(), LOCKSTEP], ids=["real time", "lock-step"])
def test_a_push_moves_the_trunk_and_is_recomputed_and_repeated(
    children: Children,
    pushed_run: Callable[..., tuple[Child, RecordedRun]],
    tmp_path: Path,
    mode: tuple[str, ...],
) -> None:
    def push(hand: Hand) -> None:
        begin_ns = hand.now_ns()
        hand.hold(40.0, begin_ns + 200_000_000)
        hand.hold(-500.0, begin_ns + 400_000_000)
        hand.ask(0.0)

    _, run = pushed_run(push, *mode)
    changes = run.operated.changes
    assert [applied for _, applied in changes][:2] == [Applied(0.0, 40.0), Applied(0.0, -MOST)]
    assert changes[-1][1] == Applied()
    assert run.count(topics.OPERATOR_REQUEST) >= len(changes)
    path = tmp_path / "run" / "run.mcap"
    verify = children.trunk("verify", path, name="verify")
    assert verify.wait() == VERIFIED, verify.stdout
    again = children.trunk("simulate", "--like", path, "-o", "again.mcap", name="again")
    if mode:
        assert again.wait() == 0, again.stderr
        verified = children.trunk("verify", "again.mcap", name="verified")
        assert verified.wait() == VERIFIED, verified.stdout
        truth = run.table(topics.GROUND_TRUTH)
        other = RecordedRun.open(tmp_path / "again.mcap").table(topics.GROUND_TRUTH)
        for quantity in ("position", "velocity", "effort"):
            assert truth.values(quantity).tobytes() == other.values(quantity).tobytes()
    branch = children.trunk("branch", path, "--at", 0.1, "-o", "branch.mcap", name="branch")
    assert branch.wait() == 0, branch.stderr
    assert children.trunk("verify", "branch.mcap", name="of_branch").wait() == VERIFIED
    applied = RecordedRun.open(tmp_path / "branch.mcap").operated.changes
    assert applied == changes


def test_who_falls_silent_lets_go(pushed_run: Callable[..., tuple[Child, RecordedRun]]) -> None:
    _, run = pushed_run(lambda hand: hand.ask(30.0))
    (begin_ns, first), (end_ns, last) = run.operated.changes
    assert (first, last) == (Applied(0.0, 30.0), Applied())
    assert 0 < end_ns - begin_ns <= 260_000_000
