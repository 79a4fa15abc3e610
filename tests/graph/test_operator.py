"""A person pushes the running trunk: the push is recorded, and the run is recomputed and repeated."""

from collections.abc import Callable
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_evidence.recorded_run import RecordedRun
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import stamp_from_ros, stamp_to_ros
from trunk_sim.inputs import Applied

from ..same_bits.paths import difference
from .peer import Peer
from .processes import Child, Children
from .services import Services
from .verbs import said, verified

pytestmark = pytest.mark.graph

MOST = 80.0  # N m
PATIENCE = 2.0  # s


class Hand:
    """An operator who sees the measured states and asks for torques."""

    def __init__(self, peer: Peer, name: str) -> None:
        self._peer, self._name = peer, name
        self._states = peer.hear_live("/joint_states")
        self._pushes = peer.hear_live(f"/{topics.OPERATOR_PUSH}")
        self._requests = peer.node.create_publisher(
            JointState, f"/{topics.OPERATOR_REQUEST}", qos.control()
        )

    def ready(self, listeners: int) -> None:
        """Wait until the simulator hears."""
        self._peer.until(
            lambda: self._requests.get_subscription_count() >= listeners,
            "somebody hears the operator",
        )

    def taken(self) -> None:
        """Wait until a push acts."""
        self._peer.until(lambda: self._pushes, "a push acts")

    def now_ns(self) -> int:
        """Return the stamp of the latest state, once there is one."""
        self._peer.until(lambda: self._states, "a state")
        return stamp_from_ros(self._states[-1].header.stamp)

    def ask(self, torque: float, stamped: bool = True, **more: object) -> None:
        message = JointState(**{"name": ["hip", "trunk"], "effort": [0.0, torque], **more})
        if stamped:
            message.header.stamp = stamp_to_ros(self.now_ns())
        message.header.frame_id = self._name
        self._requests.publish(message)

    def hold(self, torque: float, span_ns: int) -> None:
        """Ask for a torque at each state that is seen, until it was taken and then for so long.

        On a busy machine the first states that are seen are old ones.
        """
        now_ns, known, taken = self.now_ns(), len(self._pushes), max(-MOST, min(torque, MOST))
        begun_ns: int | None = None
        while begun_ns is None or now_ns < begun_ns + span_ns:
            self.ask(torque)
            self._peer.until(lambda now_ns=now_ns: self.now_ns() > now_ns, "the next state")
            now_ns = self.now_ns()
            own = (push for push in self._pushes[known:] if push.effort[1] == taken)
            begun_ns = next((stamp_from_ros(push.header.stamp) for push in own), None)


@pytest.fixture
def pushed_run(
    children: Children, peer: Peer, tmp_path: Path
) -> Callable[..., tuple[Child, RecordedRun]]:
    """Return a function that makes a run while somebody does something, and returns its recording."""

    def run(do: Callable[[Hand], None], *given: object) -> tuple[Child, RecordedRun]:
        hand = Hand(peer, "somebody")
        child = children.trunk(
            *("run", "demo", "--duration", 6, "--output", "run"),
            *("--set", f"simulator.operator.torque={MOST}"),
            *("--set", "simulator.autostart=false"),  # until the operator is heard
            # On a busy machine what the operator sees is old.
            *("--set", f"simulator.operator.timeout={PATIENCE}", *given),
        )
        assert Services(peer, "simulator").change("configure")
        hand.ready(1)
        assert Services(peer, "simulator").change("activate")
        do(hand)
        hand.taken()
        if "--lockstep" in given:
            # Slow until here: however late the hand was, the run was not over.
            assert Services(peer, "simulator").set(lockstep__speed=0.0).successful
        assert child.wait() == 0, child.stderr
        return child, RecordedRun.open(tmp_path / "run" / "run.mcap")

    return run


LOCKSTEP = ("--lockstep", "--set", "simulator.lockstep.speed=0.2")


@pytest.mark.parametrize(
    "mode",
    [pytest.param((), marks=pytest.mark.one_in(8)), LOCKSTEP],
    ids=["real time", "lock-step"],
)
def test_a_push_moves_the_trunk_and_is_recomputed_and_repeated(
    children: Children,
    pushed_run: Callable[..., tuple[Child, RecordedRun]],
    tmp_path: Path,
    mode: tuple[str, ...],
) -> None:
    def push(hand: Hand) -> None:
        hand.hold(40.0, 200_000_000)
        hand.hold(-500.0, 200_000_000)
        hand.hold(0.0, 0)

    _, run = pushed_run(push, *mode)
    pushes = run.operated.pushes
    asked = list(dict.fromkeys(applied for _, applied in pushes))
    assert asked == [Applied(0.0, 40.0), Applied(0.0, -MOST), Applied()]
    path = tmp_path / "run" / "run.mcap"
    verified(path)
    if mode:
        said("simulate", "--like", path, "-o", tmp_path / "again.mcap")
        assert difference(run, RecordedRun.open(tmp_path / "again.mcap")) == []
    # Before the first push, and a branch of that one within it.
    first_ns = pushes[0][0]
    times = [max(first_ns - 20_000_000, 0) * 1e-9, (first_ns + 100_000_000) * 1e-9]
    parent = path
    for i, at in enumerate(times):
        child = tmp_path / f"{i}.mcap"
        said("branch", parent, "--at", at, "-o", child)
        verified(child)
        assert RecordedRun.open(child).operated.pushes == pushes
        if mode:
            assert difference(run, RecordedRun.open(child)) == []
        parent = child
    explained = said("explain", path, "--at", (first_ns + 50_000_000) * 1e-9)
    assert "disturbance: trunk torque" in explained


def test_a_silent_hand_lets_go_and_malformed_requests_do_no_harm(
    children: Children, pushed_run: Callable[..., tuple[Child, RecordedRun]], tmp_path: Path
) -> None:
    def once(hand: Hand) -> None:
        hand.ask(30.0, name=["trunk", "hip"])
        hand.ask(30.0, name=["hip", "trunk", "arm"])
        hand.ask(30.0, velocity=[1.0])
        hand.ask(30.0, stamped=False)

    _, run = pushed_run(once, *LOCKSTEP)
    ((since_ns, applied),) = run.operated.pushes
    assert applied == Applied(0.0, 30.0)
    assert run.operated.at(since_ns + 2_000_000_000) == applied
    assert run.operated.at(since_ns + 2_005_000_000) == Applied()
    verified(tmp_path / "run" / "run.mcap")
