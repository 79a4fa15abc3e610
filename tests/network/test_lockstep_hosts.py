"""Lock-step over two hosts: the bits of the offline run; a dead link ends it with the silent node named."""

import shutil
import time
from pathlib import Path

import pytest

from trunk_evidence.differences import diff
from trunk_evidence.judgement import verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan, make_plan

from ..graph.processes import Child, until
from ..graph.recordings import finished_file
from .hosts import Host
from .listener import Listener
from .runs import SpreadRun

pytestmark = [pytest.mark.graph, pytest.mark.slow]

TIMEOUT_S = 2.5
WINDOW_S = 0.5  # lockstep.window: a recorder that is cut off is missed this much later


def plan_of(duration: float, **simulator: object) -> RunPlan:
    """Return the plan of a lock-step run at 1 kHz, disturbed at t = 1 s."""
    return make_plan(
        "fig8",
        "fuzzy_pid",
        settings=[f"simulator.lockstep.{name}={value}" for name, value in simulator.items()],
        everywhere={"duration": duration, "lockstep.enabled": True},
    )


def assert_same_bits(plan: RunPlan, run: Recording, folder: Path) -> None:
    """Assert that a run equals the offline run of its plan, bit by bit, and that it can be recomputed."""
    states = record_offline(plan, folder / "offline.mcap")
    found = diff(RecordedRun.open(folder / "offline.mcap"), RecordedRun(run))
    assert found.identical, found.first
    assert found.compared == 5 * states + 1  # the disturbance is published one step ahead
    verdict = verify(run)
    assert verdict.word == "verified", verdict
    assert verdict.checks[0].steps == states


def test_same_bits_as_offline(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    a, b = hosts
    plan = plan_of(1.5)
    run = SpreadRun(plan, tmp_path)
    run.start(b, "fuzzy_pid", "disturbance")
    run.start(a, "recorder", "simulator")
    assert run.simulator_ends()[0] == 0
    run.stop_all()
    assert_same_bits(plan, run.recording(), tmp_path)
    for host in hosts:
        assert host.packets() > 1500  # states one way, commands the other


def test_without_multicast_by_a_discovery_server(
    hosts: tuple[Host, Host], server: Child, tmp_path: Path
) -> None:
    a, b = hosts
    plan = plan_of(0.5)
    run = SpreadRun(plan, tmp_path)
    run.start(b, "fuzzy_pid", "disturbance")
    run.start(a, "recorder", "simulator")
    assert run.simulator_ends()[0] == 0
    run.stop_all()
    assert server.process.poll() is None, server.stderr
    assert_same_bits(plan, run.recording(), tmp_path)


# Rarely client and server of Fast DDS 2.14 wait for each other for ever (docs/hosts.md).
@pytest.mark.one_in(8)
@pytest.mark.skipif(shutil.which("iptables") is None, reason="no iptables, which loses packets")
@pytest.mark.parametrize("far", ["fuzzy_pid", "recorder", "disturbance", "simulator"])
def test_it_begins_after_a_bad_start_through_a_discovery_server(
    hosts: tuple[Host, Host], server: Child, tmp_path: Path, far: str
) -> None:
    """A third of the packets of one node is lost until somebody has missed it."""
    a, b = hosts
    plan = plan_of(0.5, timeout=600.0)
    run = SpreadRun(plan, tmp_path)
    b.lose(0.33)
    run.start(b, far)
    nodes = [name for name in plan.configs if name != far]
    run.start(a, *nodes)
    until(
        lambda: (
            any("waiting for" in run.stderr(name) for name in plan.configs)
            or run.has_ended("simulator")
        ),
        "somebody is missed, or nobody is",
    )
    b.lose(0.0)
    assert run.simulator_ends()[0] == 0
    run.stop_all()
    assert_same_bits(plan, run.recording(), tmp_path)


@pytest.mark.one_in(8)
def test_short_cut_changes_no_bit(
    hosts: tuple[Host, Host], listener: Listener, tmp_path: Path
) -> None:
    a, b = hosts
    # Neither over nor given up before the cut is mended.
    plan = plan_of(1.5, speed=0.2, timeout=600.0)
    run = SpreadRun(plan, tmp_path)
    run.start(b, "fuzzy_pid", "disturbance")
    run.start(a, "recorder", "simulator")
    listener.until_states(300)
    b.unplug()
    heard, since = 0, 0.0

    def nothing_for_a_second() -> bool:
        nonlocal heard, since
        if len(listener.torques) > heard:
            heard, since = len(listener.torques), time.monotonic()
        return time.monotonic() - since > 1.0

    until(nothing_for_a_second, "the run waits")
    assert heard < 1500
    b.plug_in()
    assert run.simulator_ends()[0] == 0
    run.stop_all()
    assert_same_bits(plan, run.recording(), tmp_path)


@pytest.mark.one_in(8)
@pytest.mark.parametrize(
    ("far", "answers", "recorded_reason"),
    [
        ("fuzzy_pid", "effort_command", "no answer from /fuzzy_pid (effort_command)"),
        ("recorder", "recorder", "the recorder was stopped before the run was finished"),
    ],
    ids=["controller", "recorder"],
)
def test_dead_link_ends_the_run(
    hosts: tuple[Host, Host],
    listener: Listener,
    tmp_path: Path,
    far: str,
    answers: str,
    recorded_reason: str,
) -> None:
    a, b = hosts
    run = SpreadRun(plan_of(60.0, speed=1.0, timeout=TIMEOUT_S), tmp_path)
    run.start(b, far)
    run.start(a, *sorted({"recorder", "fuzzy_pid", "disturbance", "simulator"} - {far}))
    listener.until_states(600)  # more than the window: the recorder is in the loop
    b.unplug()

    code, said = run.simulator_ends()
    assert code == 1
    assert "Traceback" not in said
    line = said.splitlines()[-1]
    assert f"no answer from /{far} ({answers}) to the state at t = " in line
    assert f"lockstep.timeout = {TIMEOUT_S:g} s" in line
    run.stop(far, whole=False)  # nobody acknowledges its last messages
    run.stop_all(whole=False)

    recording = run.recording()
    assert not recording.complete
    assert recording.end is not None
    assert recording.end["reason"].startswith(recorded_reason)
    (file,) = recording.files
    assert finished_file(file)["/ground_truth/joint_states"] >= 100
