"""SIGINT and SIGTERM end every node cleanly: code 0, the recording finished and marked correctly."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from trunk_msgs_util.recording.reader import Recording

from .peer import Peer
from .processes import Child, Children, until
from .recordings import finished_file

pytestmark = pytest.mark.graph

SIGNALS = [signal.SIGINT, signal.SIGTERM]
EXECUTABLES = ("simulator", "disturbance", "pid", "fuzzy_pid", "recorder")


def _file(node: str) -> list[str]:
    return ["output:=run.mcap"] if node == "recorder" else []


def stop(number: int, *children: Child, code: int = 0) -> None:
    """Send all of them the signal at once; each must end by itself, with this code."""
    for child in children:
        child.send(number)
    for child in children:
        assert child.wait() == code, child.stderr
        assert "Traceback" not in child.stderr


@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)],
    ids=lambda number: number.name,
)
def test_idle_node(children: Children, peer: Peer, tmp_path: Path, number: int) -> None:
    # Each in its own namespace: they do not meet and have nothing to do.
    started = {
        name: children.node(name, *_file(name), "-r", f"__ns:=/{name}") for name in EXECUTABLES
    }
    for name in started:
        peer.hear_run(f"/{name}")
        peer.until_up(f"/{name}/{name}")
    recorder = started.pop("recorder")
    stop(number, *started.values())
    stop(number, recorder, code=1)  # of no run at all
    counts = finished_file(tmp_path / "run.mcap")
    assert set(counts) <= {"/recorder/run/parameters", "/recorder/run/events"}
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.end == {
        "complete": "false",
        "reason": "the recorder was stopped before the run began: there is no state",
    }


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    ("number", "duration", "complete", "reason"),
    [
        (signal.SIGINT, 3600.0, "false", "stopped at t = "),
        (signal.SIGTERM, 0.0, "true", "stopped on request"),
    ],
    ids=["SIGINT before the end", "SIGTERM to an endless run"],
)
def test_nodes_of_a_run(
    children: Children,
    peer: Peer,
    tmp_path: Path,
    number: int,
    duration: float,
    complete: str,
    reason: str,
) -> None:
    """A run with a planned end is incomplete when cut short; an endless one is complete when stopped."""
    early = children.node("recorder", "output:=early.mcap", "-r", "__node:=early", name="early")
    recorder = children.node("recorder", "output:=run.mcap")
    controller = children.node("pid")
    simulator = children.node("simulator", f"duration:={duration}")
    for name in ("recorder", "early"):
        peer.until_recorded(200, name)

    cut_short = int(duration > 0.0)
    stop(number, early, code=1)
    assert finished_file(tmp_path / "early.mcap")["/joint_states"] > 20
    assert Recording.open(tmp_path / "early.mcap").warnings == [
        "incomplete: the recorder was stopped before the run was finished"
    ]
    stop(number, simulator, code=cut_short)
    stop(number, controller)
    stop(number, recorder, code=cut_short)
    finished_file(tmp_path / "run.mcap")
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.end is not None
    assert recording.end["complete"] == complete, recording.end
    assert recording.end["reason"].startswith(reason)
    (end,) = (event for event in recording.events() if event.message in ("stopped", "finished"))
    states = int(end.values["states"])
    for topic in ("/ground_truth/joint_states", "/joint_states"):
        assert recording.topics[topic].count == states


@pytest.mark.parametrize("node", ["pid", "recorder"])
def test_a_node_signalled_repeatedly_ends_cleanly(
    children: Children, peer: Peer, node: str
) -> None:
    """As when a terminal's Ctrl-C and ros2 launch both signal it: later signals must not kill it."""
    child = children.node(node, *_file(node))
    peer.until_up(node)

    def told_has_ended() -> bool:
        child.send(signal.SIGINT)
        return child.process.poll() is not None

    until(told_has_ended, "it ends", 0.005)
    assert child.wait() == int(node == "recorder"), child.stderr  # of no run at all
