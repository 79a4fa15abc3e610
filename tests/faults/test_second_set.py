"""A second set of nodes of the same names is refused before it takes part; the first run stays whole."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import Recording

from ..graph.peer import Peer
from ..graph.processes import Child, Children

pytestmark = [pytest.mark.graph, pytest.mark.usefixtures("patient")]

LOCKSTEP = "lockstep.enabled:=true"
ENDLESS = "duration:=0.0"
WAIT = f"wait_for:=[{topics.EFFORT_COMMAND}, {topics.DISTURBANCE}, recorder]"
SET = ("recorder", "pid", "disturbance", "simulator")


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUNK_PATIENCE", "200")


def start(children: Children, name: str, more: tuple[str, ...], again: str = "") -> Child:
    given = {
        "recorder": (f"output:=run{again}.mcap",),
        "simulator": (ENDLESS, WAIT),
    }.get(name, ())
    mode = () if name == "disturbance" else more
    return children.node(name, *given, *mode, name=f"{name}{again}")


def recorded_once(path: Path) -> Recording:
    recording = Recording.open(path)
    nodes = {event.node for event in recording.events() if event.message == "configured"}
    assert nodes == {f"/{name}" for name in SET}
    assert len([e for e in recording.events() if e.message == "configured"]) == len(SET)
    assert len([p for p in recording.parameter_messages() if p.new]) == len(SET)
    return recording


@pytest.mark.parametrize("more", [(), (LOCKSTEP,)], ids=["real time", "lock-step"])
def test_nodes_started_by_hand_beside_those_of_a_run(
    children: Children, peer: Peer, tmp_path: Path, more: tuple[str, ...]
) -> None:
    first = {name: start(children, name, more) for name in SET}
    peer.until_recorded(400)
    second = {name: start(children, name, more, again="_again") for name in SET}
    for name, node in second.items():
        assert node.wait() == 1, node.stderr
        (line,) = node.stderr.splitlines()
        assert line == (
            f"{name}: error: another /{name} is running, in process {first[name].process.pid}: stop it, "
            "or give each its own namespace or ROS_DOMAIN_ID"
        )
    peer.until_recorded(800 + int(peer.last_diagnostics("recorder")["messages"]))
    for name in reversed(SET):
        assert first[name].stop() == 0, first[name].stderr
    recording = recorded_once(tmp_path / "run.mcap")
    assert recording.complete, recording.warnings
    assert not (tmp_path / "run_again.mcap").exists()


def test_nodes_started_by_hand_beside_trunk_run(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """The run is stopped and not awaited: a busy machine may need longer to start each node than any run."""
    run = children.trunk(
        "run", "demo", "--controller", "pid", "--duration", 3600, "--output", "first"
    )
    peer.until_started(run)
    peer.until_recorded(400)
    for name in SET:
        node = start(children, name, (), again="_again")
        assert node.wait() == 1, node.stderr
        assert f"another /{name} is running" in node.stderr
    assert run.process.poll() is None, run.stderr
    peer.until_recorded(400 + int(peer.last_diagnostics("recorder")["messages"]))
    assert run.stop() == 1
    assert run.stderr.splitlines()[-1].startswith("trunk: error: stopped by SIGINT"), run.stderr
    (lacking,) = recorded_once(tmp_path / "first" / "run.mcap").warnings
    assert re.fullmatch(r"incomplete: stopped at t = [\d.]+ s, before its end", lacking)


def test_a_node_may_take_the_place_of_one_that_was_killed(children: Children, peer: Peer) -> None:
    first = children.node("pid")
    peer.until_event("pid", "configured")
    first.process.kill()
    first.wait()
    second = children.node("pid", name="second")
    peer.until(lambda: [e[:2] for e in peer.events].count(("/pid", "configured")) == 2, "it is up")
    assert second.stop() == 0, second.stderr


def test_in_a_namespace_of_its_own_a_node_is_another_one(children: Children, peer: Peer) -> None:
    peer.hear_run("/robot2")
    nodes = [children.node("pid"), children.node("pid", "-r", "__ns:=/robot2", name="second")]
    for name in ("pid", "robot2/pid"):
        peer.until_event(name, "configured")
    assert [node.stop() for node in nodes] == [0, 0]
