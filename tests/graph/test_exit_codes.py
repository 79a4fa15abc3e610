"""A node that was to see a run through to its end, and did not, says so by its exit code: docs/faults.md."""

from __future__ import annotations

import signal

import pytest

from trunk_msgs_util import topics

from .peer import Peer
from .processes import Child, Children

pytestmark = pytest.mark.graph

LONG, ENDLESS = "duration:=3600.0", "duration:=0.0"
LOCKSTEP = ("lockstep.enabled:=true", "lockstep.speed:=1.0")
ALL = "wait_for:=[effort_command, recorder]"


class ByHand:
    """A simulator, its controller and a recorder, each started by itself."""

    def __init__(self, children: Children, peer: Peer) -> None:
        self._children, self._peer = children, peer
        peer.hear_run()

    def start(self, *simulator: str, lockstep: bool = True) -> dict[str, Child]:
        """Start them, and wait until the run has begun and states are recorded."""
        mode = LOCKSTEP if lockstep else ()
        names = {"recorder": mode[:1], "pid": mode[:1], "simulator": (*mode, ALL, *simulator)}
        nodes = {
            name: self._children.node(
                name, *options, *(["output:=run.mcap"] * (name == "recorder"))
            )
            for name, options in names.items()
        }
        states = self._peer.hear(topics.JOINT_STATES)
        self._peer.until(lambda: len(states) > 20, "states are published")
        return nodes


@pytest.fixture
def by_hand(children: Children, peer: Peer) -> ByHand:
    return ByHand(children, peer)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("duration", "order", "codes"),
    [
        ("duration:=0.3", ("simulator", "pid", "recorder"), (0, 0, 0)),
        (LONG, ("simulator!", "pid", "recorder"), (1, 0, 1)),
        (LONG, ("recorder!", "simulator!", "pid"), (1, 1, 0)),
        (ENDLESS, ("simulator!", "pid", "recorder"), (0, 0, 0)),
        (ENDLESS, ("recorder!", "simulator!", "pid"), (1, 0, 0)),
    ],
    ids=["end", "simulator", "recorder", "endless", "endless, recorder"],
)
@pytest.mark.parametrize("lockstep", [True, False])
def test_stopped(
    by_hand: ByHand, lockstep: bool, duration: str, order: tuple[str, ...], codes: tuple[int, ...]
) -> None:
    """``!``: this node is told to stop while the run is under way, the others once it is over."""
    nodes = by_hand.start(duration, lockstep=lockstep)
    for name, code in zip(order, codes, strict=True):
        node = nodes[name.rstrip("!")]
        ended = node.wait() if name == "simulator" else node.stop()
        assert ended == code, f"{name}: {node.stderr}"


@pytest.mark.parametrize("killed", ["simulator", "pid"])
def test_killed_in_lockstep(by_hand: ByHand, killed: str) -> None:
    nodes = by_hand.start(LONG, "lockstep.timeout:=1.0")
    nodes[killed].stop(signal.SIGKILL)
    if killed == "pid":
        assert nodes["simulator"].wait() == 1
    else:
        assert nodes["pid"].stop() == 0
    assert nodes["recorder"].stop() == 1, nodes["recorder"].stderr
    assert "INCOMPLETE" in nodes["recorder"].stderr


@pytest.mark.parametrize("duration", [LONG, ENDLESS])
def test_stopped_before_the_run_begins(children: Children, peer: Peer, duration: str) -> None:
    nodes = [children.node("recorder", "output:=run.mcap"), children.node("simulator", duration)]
    peer.until_event("simulator", "activated")
    peer.until_event("recorder", "activated")
    peer.until_recorded(6)  # parameters, and two events, of each
    assert nodes[1].stop() == int(duration == LONG), nodes[1].stderr
    assert nodes[0].stop() == 1, nodes[0].stderr


def test_a_recorder_of_no_run_at_all(children: Children, peer: Peer) -> None:
    recorder = children.node("recorder", "output:=run.mcap")
    peer.until_event("recorder", "activated")
    assert recorder.stop() == 1
    assert "the recorder was stopped before the run began" in recorder.stderr
