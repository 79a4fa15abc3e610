"""A second node of a name, or a second controller, is refused before it acts; the first run stays whole."""

import os
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from trunk_core import topics
from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording
from trunk_runs.monitor_node import Monitor

from ..graph.peer import Peer
from ..graph.processes import Child, Children
from ..graph.recordings import finished_file

pytestmark = pytest.mark.graph

LOCKSTEP = "lockstep.enabled:=true"
ENDLESS = "duration:=0.0"
WAIT = f"wait_for:=[{topics.EFFORT_COMMAND}, {topics.DISTURBANCE}, recorder]"
SET = ("recorder", "pid", "disturbance", "simulator")


@pytest.mark.parametrize("options", [(), ("--composed",)], ids=["processes", "composed"])
def test_second_node_of_a_name_is_refused(
    children: Children, peer: Peer, options: tuple[str, ...]
) -> None:
    other = children.node("disturbance")
    peer.until_event("disturbance", "configured")
    run = children.trunk("run", "demo", "--duration", 3600, "--output", "run", *options)
    assert run.wait() == 1
    # By the events that the run hears, or by its own node, which is refused.
    assert re.search(r"another /?disturbance is running.*: stop it", run.stderr.splitlines()[-1])
    assert other.stop() == 0


@pytest.mark.parametrize("verb", ["run", pytest.param("live", marks=pytest.mark.one_in(8))])
def test_a_second_run_is_refused_before_it_starts_anything(
    children: Children, peer: Peer, tmp_path: Path, verb: str
) -> None:
    first = children.trunk("run", "demo", "--duration", 3600, "--output", tmp_path / "first")
    peer.until_event("simulator", "started")
    page = ["--no-browser"] if verb == "live" else []
    second = children.trunk(verb, "demo", "--output", tmp_path / "second", *page)
    assert second.wait() == 1
    assert second.stderr == (
        f"trunk: error: another run is under way in ROS domain {os.environ['ROS_DOMAIN_ID']}, in process "
        f"{first.process.pid}: stop it or wait for its end, or set ROS_DOMAIN_ID to another number\n"
    )
    assert not (tmp_path / "second").exists()
    assert first.process.poll() is None
    first.stop()
    events = Recording.open(tmp_path / "first" / "run.mcap").events("/run/events")
    assert [e.node for e in events if e.message == "configured"].count("/simulator") == 1


def test_a_node_is_doubled_by_its_events_not_by_discovery(domain: int) -> None:
    with Monitor() as monitor:
        node = monitor._node
        monitor._node = SimpleNamespace(get_fully_qualified_node_names=lambda: ["/simulator"] * 2)
        own = {"simulator": "boot.1.1", "recorder": "boot.2.2"}

        def says(name: str, process: str) -> None:
            values = [KeyValue(key="process", value=process)]
            status = DiagnosticStatus(name=name, message="configured", values=values)
            monitor._on_event(DiagnosticArray(status=[status]))

        for name, process in own.items():
            says(f"/{name}", process)
            says(f"/{name}", process)  # cleaned up and configured again
            says(f"/robot/{name}", "boot.3.3")  # in a namespace: another run's
        assert monitor.doubled(own) == []
        says("/recorder", "boot.4.4")
        assert monitor.doubled(own) == ["recorder"]
        monitor._node = node


def start(children: Children, name: str, more: tuple[str, ...], again: str = "") -> Child:
    given = {
        "recorder": (f"output:=run{again}.mcap",),
        "simulator": (ENDLESS, WAIT),
    }.get(name, ())
    mode = () if name == "disturbance" else more
    return children.node(name, *given, *mode, name=f"{name}{again}")


def recorded_once(path: Path) -> Recording:
    recording = Recording.open(path)
    nodes = {
        event.node for event in recording.events("/run/events") if event.message == "configured"
    }
    assert nodes == {f"/{name}" for name in SET}
    assert len([e for e in recording.events("/run/events") if e.message == "configured"]) == len(
        SET
    )
    assert len([p for p in recording.parameter_messages("/run/parameters") if p.new]) == len(SET)
    return recording


@pytest.mark.virtual
@pytest.mark.usefixtures("patient")
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
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    assert not (tmp_path / "run_again.mcap").exists()


@pytest.mark.usefixtures("patient")
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
    assert run.stop() == 130
    assert run.stderr.splitlines()[-1].startswith("trunk: error: stopped by SIGINT"), run.stderr
    (lacking,) = recorded_once(tmp_path / "first" / "run.mcap").warnings
    assert re.fullmatch(r"incomplete: stopped at t = [\d.]+ s, before its end", lacking)


@pytest.mark.virtual
def test_a_node_may_take_the_place_of_one_that_was_killed(children: Children, peer: Peer) -> None:
    first = children.node("pid")
    peer.until_event("pid", "configured")
    first.process.kill()
    first.wait()
    second = children.node("pid", name="second")
    peer.until(lambda: [e[:2] for e in peer.events].count(("/pid", "configured")) == 2, "it is up")
    assert second.stop() == 0, second.stderr


@pytest.mark.virtual
def test_in_a_namespace_of_its_own_a_node_is_another_one(children: Children, peer: Peer) -> None:
    peer.hear_run("/robot2")
    nodes = [children.node("pid"), children.node("pid", "-r", "__ns:=/robot2", name="second")]
    for name in ("pid", "robot2/pid"):
        peer.until_event(name, "configured")
    assert [node.stop() for node in nodes] == [0, 0]


@pytest.mark.parametrize("when", [pytest.param("before", marks=pytest.mark.one_in(8)), "during"])
def test_second_controller_is_refused(
    children: Children, peer: Peer, tmp_path: Path, when: str
) -> None:
    run = (
        children.trunk("run", "demo", "--duration", 3600, "--output", "run")
        if when == "during"
        else None
    )
    if run:
        peer.until_started(run)
        peer.until_recorded(500)
    intruder = children.node("pid")
    peer.until_up("pid")
    run = run or children.trunk("run", "demo", "--output", "run")
    assert run.wait() == 1, run.stderr
    assert intruder.stop() == 0, intruder.stderr
    line = run.stderr.splitlines()[-1]
    assert line.startswith("trunk: error: ")
    assert "2 nodes publish /effort_command: /fuzzy_pid, /pid" in line
    assert "stop the others" in line
    children.none_left()
    finished_file(tmp_path / "run" / "run.mcap")
    assert not Recording.open(tmp_path / "run" / "run.mcap").complete
