"""Runs of the real nodes are branched: their past as recorded, what follows simulated; both verify."""

import struct
from pathlib import Path

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied
from std_srvs.srv import Trigger

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_core.units import nanoseconds, seconds
from trunk_evidence.branching import Branch
from trunk_evidence.differences import RunDiff, diff
from trunk_evidence.judgement import DIVERGES, UNJUDGED, VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_msgs_util.node.conversions import sample_to_ros, stamp_from_ros

from ..same_bits.paths import branched_at, difference
from .peer import Peer
from .processes import Children
from .services import Services

pytestmark = pytest.mark.graph

CHANGES = (
    Branch(0.0, controller="lqr"),
    Branch(0.0, ("simulator.max_effort=30", "disturbance.sine.amplitude=10")),
    Branch(0.0, pushes=("60Nm:0.1s",)),
    Branch(0.0, controller="computed_torque", pushes=("hip_effort=100N:50ms",)),
)


def made(path: Path, branch: Branch, out: Path) -> RunDiff:
    """Branch a run; return how it differs from its parent. Whatever was changed, it verifies."""
    run = RecordedRun.open(path)
    found = branched_at(run, branch, out)
    verdict = verdict_on(found)
    assert verdict.exit_code == VERIFIED, (branch, verdict.reasons)
    assert any("simulated with" in note for note in verdict.notes)
    return diff(run, found)


@pytest.mark.parametrize(
    "mode", [pytest.param("lock-step", marks=pytest.mark.one_in(8)), "real time"]
)
def test_a_run_of_the_real_nodes_is_branched(children: Children, tmp_path: Path, mode: str) -> None:
    more = ["--lockstep"] if mode == "lock-step" else []
    run = children.trunk(
        "run", "demo", "--controller", "pid", "--duration", 1.5, "-o", "run", *more
    )
    assert run.wait() == 0, run.stderr
    path = tmp_path / "run" / "run.mcap"
    parent = RecordedRun.open(path)
    for at in (0.0, 0.3331, 1.5):
        if mode == "lock-step":
            same = branched_at(parent, Branch(at), tmp_path / "branch.mcap")
            assert difference(parent, same) == []
        for change in CHANGES:
            found = made(path, change._replace(at=at), tmp_path / "branch.mcap")
            assert found.first is None or found.first.stamp_ns >= nanoseconds(at)


@pytest.mark.usefixtures("patient")
@pytest.mark.one_in(8)
def test_an_eventful_run_is_branched_at_any_time(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    truth = peer.hear(topics.GROUND_TRUTH)
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid = children.node("pid", "gains.i:=20.0")
    simulator = children.node(
        "simulator", "duration:=0.0", "update_rate:=200.0", "wait_for:=[effort_command,recorder]"
    )
    plant, controller = Services(peer, "simulator"), Services(peer, "pid")
    for i_gain in (35.0, 5.0):
        later = len(truth) + 50
        peer.until(lambda later=later: len(truth) > later, "the run goes on")
        assert controller.set(gains__i=i_gain).successful
        assert plant.set(plant__length=1.0 + 0.001 * i_gain).successful
        assert plant.change("deactivate")
        assert controller.change("deactivate")
        assert peer.call(Trigger, "/pid/reset").success
        assert controller.change("activate")
        assert plant.change("activate")
        assert peer.call(Trigger, "/simulator/reset").success
    later = len(truth) + 50
    peer.until(lambda: len(truth) > later, "the run goes on")
    for child in (simulator, pid, recorder):
        assert child.stop() == 0, child.stderr
    path = tmp_path / "run.mcap"
    run = RecordedRun.open(path)
    assert verdict_on(run).exit_code == VERIFIED
    turns = sorted({max(event.stamp_ns, 0) for event in run.events})
    last = int(run.table(topics.GROUND_TRUTH).stamp_ns.max())
    for i, stamp_ns in enumerate((*turns, *(one + 5_000_000 for one in turns))):
        at = seconds(min(stamp_ns, last))
        # Each kind in turn.
        kinds = (Branch(at), Branch(at, controller="lqr"), Branch(at, ("pid.gains.p=80",)))
        for change in kinds[i % 3 : i % 3 + 1]:
            found = made(path, change, tmp_path / "branch.mcap")
            assert found.first is None or found.first.stamp_ns >= nanoseconds(at)


@pytest.mark.usefixtures("patient")
def test_a_branch_may_begin_before_somebody_elses_disturbances(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """The simulator took the first one before that begins to act; a branch repeats none."""
    truth = peer.hear(topics.GROUND_TRUTH)
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid = children.node("pid")
    simulator = children.node(
        "simulator", "duration:=0.0", "update_rate:=200.0", "wait_for:=[effort_command,recorder]"
    )
    disturb = peer.publisher(topics.DISTURBANCE, "simulator", "recorder")
    peer.until(lambda: len(truth) > 50, "the run goes on")
    assert Services(peer, "simulator").change("deactivate")  # simulated time stands still
    stamp_ns = peer.until_event("simulator", Event.PAUSED).stamp_ns + 100_000_000
    said = JointSample(stamp_ns, ("hip", "trunk"), (0.0, 0.0), effort=(0.0, 5.0))
    disturb.publish(sample_to_ros(said))
    peer.until_received(disturb)
    assert Services(peer, "simulator").change("activate")
    peer.until(lambda: stamp_from_ros(truth[-1].header.stamp) > stamp_ns, "it has acted")
    for child in (simulator, pid, recorder):
        assert child.stop() == 0, child.stderr
    path = tmp_path / "run.mcap"
    run = RecordedRun.open(path)
    assert run.recording.complete
    verdict = verdict_on(run)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    # What acted is on record. What that node should have said is not, and the verdict tells so.
    assert "disturbance: 1 messages of external nodes" in verdict.unjudged
    assert "disturbances" not in {check.name for check in verdict.checks}
    states = run.count(topics.GROUND_TRUTH)
    assert [check.steps for check in verdict.checks if "plant" in check.name] == [states, states]

    def altered(messages: list[list]) -> None:
        (message,) = (message for message in messages if message[0] == f"/{topics.DISTURBANCE}")
        message[2] = message[2][:-8] + struct.pack("<d", 6.0)

    def unheard(messages: list[list]) -> None:
        messages[:] = [message for message in messages if message[0] != f"/{topics.DISTURBANCE}"]

    for edit, code in ((altered, DIVERGES), (unheard, UNJUDGED)):
        found = verdict_on(RecordedRun(copied(path, tmp_path / "edited.mcap", edit, ANEW)))
        assert found.exit_code == code, found.reasons
    (said_ns,) = (event.stamp_ns for event in run.events if event.message == Event.PAUSED)
    assert said_ns < stamp_ns
    for at_ns in (100_000_000, said_ns, stamp_ns - 5_000_000):
        made(path, Branch(seconds(at_ns)), tmp_path / "branch.mcap")
        assert RecordedRun.open(tmp_path / "branch.mcap").count(topics.DISTURBANCE) == 0
