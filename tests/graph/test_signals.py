"""Nodes that are told to end, or killed: exit codes (docs/faults.md), and what the recording says of it."""

import signal
from pathlib import Path

import pytest

from trunk_evidence.judgement import UNJUDGED, VERIFIED, verify
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Child, Children, until
from .recordings import finished_file

pytestmark = pytest.mark.graph

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
    [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.one_in(8))],
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


LONG, ENDLESS = "duration:=3600.0", "duration:=0.0"
LOCKSTEP = ("lockstep.enabled:=true", "lockstep.speed:=1.0")
ALL = "wait_for:=[effort_command, recorder]"
EARLY = "the recorder was stopped before the run was finished"


def started(
    children: Children, peer: Peer, simulator: tuple[str, ...], mode: tuple[str, ...]
) -> dict[str, Child]:
    """Start simulator, controller and recorder, each by itself; return them once something is recorded."""
    given = {
        "recorder": (*mode[:1], "output:=run.mcap"),
        "pid": mode[:1],
        "simulator": (*mode, ALL, *simulator),
    }
    nodes = {name: children.node(name, *options) for name, options in given.items()}
    peer.until_recorded(200)
    return nodes


# duration, who ends in which order, exit codes, and the end of the recording.
STOPPED = {
    "end": ("duration:=0.3", "simulator pid recorder", (0, 0, 0), "finished"),
    "simulator": (LONG, "simulator! pid recorder", (1, 0, 1), "stopped at t = "),
    "recorder": (LONG, "recorder! simulator! pid", (1, 1, 0), EARLY),
    "endless": (ENDLESS, "simulator! pid recorder", (0, 0, 0), "stopped on request"),
    "endless, recorder": (ENDLESS, "recorder! simulator! pid", (1, 0, 0), EARLY),
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", STOPPED)
@pytest.mark.parametrize("mode", [LOCKSTEP, ()], ids=["lock-step", "real time"])
def test_stopped(
    children: Children,
    peer: Peer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    mode: tuple[str, ...],
    name: str,
) -> None:
    """``!``: this node is told to stop while the run is under way, the others once it is over.

    A run with a planned end is incomplete when cut short; an endless one is complete when stopped.
    """
    duration, order, codes, reason = STOPPED[name]
    number = signal.SIGTERM if duration == ENDLESS else signal.SIGINT
    if order.endswith("recorder"):
        monkeypatch.setenv("TRUNK_PATIENCE", "200")  # as the fixture ``patient``
    nodes = started(children, peer, (duration,), mode)
    for who, code in zip(order.split(), codes, strict=True):
        node = nodes[who.rstrip("!")]
        ended = node.wait() if who == "simulator" else node.stop(number)
        assert ended == code, f"{who}: {node.stderr}"
        assert "Traceback" not in node.stderr
    finished_file(tmp_path / "run.mcap")
    recording = Recording.open(tmp_path / "run.mcap")
    whole = codes[order.split().index(next(w for w in order.split() if "recorder" in w))] == 0
    assert recording.end is not None
    assert recording.end["complete"] == str(whole).lower(), recording.end
    assert recording.end["reason"].startswith(reason)
    verdict = verify(recording)
    assert verdict.exit_code == (VERIFIED if whole else UNJUDGED), verdict
    assert sum(reason in line for line in verdict.obstacles) == (not whole)
    if reason == EARLY:
        assert nodes["recorder"].stderr.splitlines()[-1].endswith(f"INCOMPLETE: {EARLY}")
        return
    (end,) = (
        event
        for event in recording.events("/run/events")
        if event.message in ("stopped", "finished")
    )
    for topic in ("/ground_truth/joint_states", "/joint_states"):
        assert recording.topics[topic].count == int(end.values["states"])


@pytest.mark.usefixtures("patient")
def test_one_of_two_recorders_is_stopped(children: Children, peer: Peer, tmp_path: Path) -> None:
    early = children.node("recorder", "output:=early.mcap", "-r", "__node:=early", name="early")
    nodes = started(children, peer, (ENDLESS,), ())
    peer.until_recorded(200, "early")
    assert early.stop() == 1
    assert finished_file(tmp_path / "early.mcap")["/joint_states"] > 20
    assert Recording.open(tmp_path / "early.mcap").warnings == [f"incomplete: {EARLY}"]
    assert [nodes[name].stop() for name in ("simulator", "pid", "recorder")] == [0, 0, 0]
    assert Recording.open(tmp_path / "run.mcap").complete


@pytest.mark.parametrize("gone", ["simulator", "pid", "recorder"])
def test_gone_in_lockstep(children: Children, peer: Peer, gone: str) -> None:
    nodes = started(children, peer, (LONG, "lockstep.timeout:=1.0"), LOCKSTEP)
    if gone == "recorder":
        assert nodes[gone].stop() == 1
    else:
        nodes[gone].stop(signal.SIGKILL)
    if gone != "simulator":
        assert nodes["simulator"].wait() == 1
        assert f"no answer from /{gone}" in nodes["simulator"].stderr
    if gone != "pid":
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
