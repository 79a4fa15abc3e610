"""Managed nodes: ROS 2's ordinary transitions in any order."""

from pathlib import Path

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_core import topics
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verify
from trunk_evidence.verdict import Verdict
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_recording.reader import Recording
from trunk_runs.plan import make_plan

from .peer import Peer
from .processes import Children
from .services import Services

pytestmark = pytest.mark.graph

UNCONFIGURED, INACTIVE, ACTIVE = "unconfigured", "inactive", "active"


@pytest.mark.virtual
@pytest.mark.parametrize("node", ["simulator", "disturbance", "pid", "fuzzy_pid", "recorder"])
def test_every_transition(children: Children, peer: Peer, tmp_path: Path, node: str) -> None:
    file = ("output:=run.mcap", "overwrite:=true") if node == "recorder" else ()
    child = children.node(node, "autostart:=false", *file)
    peer.until_up(node)
    life = Services(peer, node)
    assert life.state() == UNCONFIGURED
    assert not (tmp_path / "run.mcap").exists()
    assert not life.change(
        "activate"
    )  # not available in this state: refused, and the node keeps running
    assert (
        "transition refused: activate; this node is unconfigured, which allows configure or shutdown"
        in child.stderr + child.stdout
    )
    for label, state in (
        ("configure", INACTIVE),
        ("activate", ACTIVE),
        ("deactivate", INACTIVE),
        ("cleanup", UNCONFIGURED),
        ("configure", INACTIVE),
        ("activate", ACTIVE),
    ):
        assert label in life.available()
        assert life.change(label), label
        assert life.state() == state
    assert peer.fresh_diagnostics(node)["lifecycle"] == ACTIVE
    peer.until_event(node, "cleaned up")
    assert life.change("active_shutdown")
    assert child.wait() == int(node == "recorder"), child.stderr  # of no run at all
    assert "Traceback" not in child.stderr
    if node == "recorder":
        assert Recording.open(tmp_path / "run.mcap").end is not None


@pytest.mark.virtual
def test_a_recorder_that_cannot_be_configured(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    (tmp_path / "run.mcap").touch()
    child = children.node("recorder", "autostart:=false", "output:=run.mcap")
    peer.until_up("recorder")
    life = Services(peer, "recorder")
    assert not life.change("configure")
    assert life.state() == UNCONFIGURED
    (tmp_path / "run.mcap").unlink()
    assert life.change("configure")
    assert child.stop() == 1  # nothing is recorded
    assert "'run.mcap' is not allowed: it exists" in child.stderr + child.stdout


@pytest.mark.virtual
def test_the_plant_waits_for_an_inactive_controller(children: Children, peer: Peer) -> None:
    truth = peer.hear(topics.GROUND_TRUTH)
    pid = children.node("pid", "autostart:=false")
    simulator = children.node("simulator", "duration:=0.5", "lockstep.enabled:=true")
    peer.until_up("pid")
    life = Services(peer, "pid")
    assert life.change("configure")
    before = len(peer.events)
    peer.until(lambda: "simulator" in {n.strip("/") for n, _ in peer.diagnostics}, "it diagnoses")
    peer.fresh_diagnostics("simulator")  # longer than a stranger would be waited for
    assert not [e for e in peer.events[before:] if e.message in ("ready", "started")]
    assert truth == []
    assert life.change("activate")
    assert simulator.wait() == 0, simulator.stderr
    assert pid.stop() == 0


@pytest.mark.virtual
def test_deactivating_the_simulator_pauses_the_run(children: Children, peer: Peer) -> None:
    """While the simulator is inactive the run is paused: stamps stand still, then go on."""
    truth = peer.hear(topics.GROUND_TRUTH)
    pid = children.node("pid")
    simulator = children.node("simulator")
    peer.until(lambda: len(truth) > 50, "the run goes on")
    life = Services(peer, "simulator")
    assert life.change("deactivate")
    held_ns = peer.until_event("simulator", "paused").stamp_ns
    peer.until(lambda: stamp_from_ros(truth[-1].header.stamp) >= held_ns, "all states came")
    peer.until(lambda: peer.last_diagnostics("simulator")["state"] == "paused", "it says so")
    assert peer.fresh_diagnostics("simulator")["state"] == "paused"
    assert stamp_from_ros(truth[-1].header.stamp) == held_ns
    assert life.change("activate")
    peer.until(lambda: stamp_from_ros(truth[-1].header.stamp) > held_ns + 10**8, "it goes on")
    assert [simulator.stop(), pid.stop()] == [0, 0]


def test_a_run_whose_recorder_is_managed_by_hand(children: Children, peer: Peer) -> None:
    run = children.trunk(
        "run", "demo", "--duration", 0.2, "--output", "run", "--set", "recorder.autostart=false"
    )
    peer.until_event("fuzzy_pid", "ready")
    life = Services(peer, "recorder")
    assert life.change("configure")
    assert not [event for event in peer.events if event.message == "started"]
    assert life.change("activate")
    assert run.wait() == 0, run.stderr
    assert "complete: 41 states, 41 commands recorded" in run.stdout
    children.none_left()


@pytest.mark.virtual
def test_a_controller_that_nobody_configures(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """Standing by, as `trunk live` starts all but one: the run is whole all the same."""
    everywhere = {"duration": 0.1, "lockstep.enabled": True}
    plan = make_plan("demo", "fuzzy_pid", standby=["pid"], everywhere=everywhere)
    plan.write_parameters(tmp_path / "plan.yaml")
    arguments = ("--params-file", tmp_path / "plan.yaml")
    nodes = {name: children.node(name, *arguments) for name in plan.configs if name != "recorder"}
    peer.until_up("pid")
    recorder = children.node("recorder", *arguments, "output:=run.mcap")
    assert nodes.pop("simulator").wait() == 0
    assert [node.stop() for node in nodes.values()] == [0, 0, 0]
    assert recorder.stop() == 0, recorder.stderr
    verdict = verify(Recording.open(tmp_path / "run.mcap"))
    assert verdict.exit_code == VERIFIED, verdict


@pytest.mark.virtual
@pytest.mark.usefixtures("patient")
def test_a_recorder_that_was_inactive_for_a_while(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """The recording has its transitions; both sides of what it missed are judged, the gap is not."""
    truth = peer.hear(topics.GROUND_TRUTH)
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid = children.node("pid")
    simulator = children.node("simulator", "duration:=0.0", "wait_for:=[effort_command,recorder]")
    life = Services(peer, "recorder")
    for label in ("deactivate", "activate"):
        later = len(truth) + 100
        peer.until(lambda later=later: len(truth) > later, "the run goes on")
        assert life.change(label)
    later = len(truth) + 100
    peer.until(lambda: len(truth) > later, "the run goes on")
    assert [simulator.stop(), pid.stop(), recorder.stop()] == [0, 0, 1], recorder.stderr
    recording = Recording.open(tmp_path / "run.mcap")
    turns = [e.message for e in recording.events("/run/events") if e.node == "/recorder"]
    assert turns[-2:] == ["deactivated", "activated"]
    verdict = verify(recording)
    assert verdict.exit_code == UNJUDGED, verdict
    assert "the recorder was inactive for a while: what it missed is not known" in verdict.obstacles
    assert len(verdict.obstacles) == len(set(verdict.obstacles))
    states = recording.joints("/ground_truth/joint_states").stamp_ns
    (gap,) = np.flatnonzero(np.diff(states) > 5_000_000)
    checks = {check.name: check for check in verdict.checks}
    for name in ("states of the plant", "measured states"):
        assert (checks[name].from_ns, checks[name].until_ns) == (0, states[-1]), name
    # What the controller remembers of the gap is not known: none of its later commands is judged.
    commands = checks["commands of pid"]
    assert commands.from_ns == 0
    assert commands.until_ns is not None
    assert commands.until_ns <= states[gap]
    assert commands.unjudged > 0

    def without_queue(topic: str) -> Verdict:
        """Judge the recording as if one topic's messages had still been queued, and so were dropped."""

        def edit(messages: list[list]) -> None:
            at = next(i for i, m in enumerate(messages) if b"deactivated\0" in m[2])
            messages[:at] = [m for m in messages[:at] if m[0] != topic]

        return verify(copied(tmp_path / "run.mcap", tmp_path / "edited.mcap", edit, ANEW))

    queues = "/pid/state", "/effort_command", "/joint_states", "/ground_truth/joint_states"
    for topic in (*queues, "/plant/inputs"):
        assert without_queue(topic).exit_code == UNJUDGED, topic
