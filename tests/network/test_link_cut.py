"""Real time, and the link between simulator and controller cut for 2 s: no torque, then control again."""

import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from trunk_core import topics
from trunk_evidence.judgement import VERIFIED, verify
from trunk_msgs_util.node.middleware import SUPER_CLIENT
from trunk_runs.plan import make_plan

from ..graph.processes import Child, until
from ..graph.recordings import assert_every_step, finished_file, joints
from .hosts import Host
from .listener import Listener
from .runs import SpreadRun

pytestmark = [pytest.mark.graph, pytest.mark.slow]

_PD = Path(__file__).parents[2] / "examples" / "nodes" / "pd_rclpy.py"
RATE_HZ = 200
PERIOD_NS = 5_000_000
CUT_S, TIMEOUT_S = 2.0, 0.2
TIMEOUT_STEPS = round(TIMEOUT_S * RATE_HZ)
WITHOUT_TORQUE = round((CUT_S - TIMEOUT_S) * RATE_HZ)
STEPS_WITHOUT = "steps without a fresh command"


def longest_run(true: NDArray[np.bool_]) -> tuple[int, int]:
    """Return first and one-past-last index of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], true, [False]))))
    first, end = edges[::2], edges[1::2]
    longest = np.argmax(end - first)
    return int(first[longest]), int(end[longest])


def test_it_begins_through_a_discovery_server(
    hosts: tuple[Host, Host], server: Child, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a node learns only of topics on which it has an endpoint itself."""
    monkeypatch.setenv(SUPER_CLIENT, "FALSE")
    a, b = hosts
    run = SpreadRun(make_plan("fig8", "fuzzy_pid", everywhere={"duration": 0.5}), tmp_path)
    run.start(b, "fuzzy_pid", "disturbance")
    run.start(a, "recorder", "simulator")
    assert run.simulator_ends()[0] == 0
    run.stop_all()
    assert server.process.poll() is None, server.stderr
    assert run.recording().complete, run.recording().warnings
    assert verify(run.recording()).exit_code == VERIFIED


def test_a_node_of_anybodys_is_recorded_through_a_discovery_server(
    hosts: tuple[Host, Host], server: Child, tmp_path: Path
) -> None:
    a, b = hosts
    plan = make_plan("fig8", "pid", everywhere={"duration": 0.5}, external="mine")
    node = b.children.start("mine", sys.executable, _PD)
    run = SpreadRun(plan, tmp_path)
    run.start(a, *plan.configs)
    assert run.simulator_ends()[0] == 0
    node.stop(signal.SIGKILL)  # rclpy may miss any other signal while it waits
    run.stop_all()
    recording = run.recording()
    assert recording.complete, recording.warnings
    assert recording.topics[f"/{topics.EFFORT_COMMAND}"].count
    assert verify(recording).exit_code == VERIFIED


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("cut", "mend", "recorded_on"),
    [(Host.unplug, Host.plug_in, 1), (Host.interface_down, Host.interface_up, 0)],
    ids=["silent link, recorder beyond it", "interface down, recorder on this side"],
)
def test_two_seconds_without_the_link(
    hosts: tuple[Host, Host],
    listener: Listener,
    tmp_path: Path,
    cut: Callable[[Host], None],
    mend: Callable[[Host], None],
    recorded_on: int,
) -> None:
    a, b = hosts
    run = SpreadRun(
        make_plan(
            "demo",
            "fuzzy_pid",
            settings=["disturbance.pulse.magnitude=0.0"],
            everywhere={"duration": 0.0},
        ),
        tmp_path,
    )
    run.start(hosts[recorded_on], "recorder")
    run.start(b, "fuzzy_pid")
    run.start(a, "simulator")
    listener.until_states(RATE_HZ)

    cut(b)
    until(
        lambda: not any(listener.torques[-WITHOUT_TORQUE:]),
        "the torque is zero over the cut",
    )
    mend(b)
    until(lambda: listener.torques[-1], "the controller acts again")
    steps_without = int(listener.fresh_diagnostics()[STEPS_WITHOUT])
    run.stop("simulator")
    run.stop_all()

    recording = run.recording()
    assert recording.complete, recording.warnings
    finished_file(recording.files[0])
    (end,) = (event for event in recording.events("/run/events") if event.message == "finished")
    assert_every_step(recording, PERIOD_NS, int(end.values["states"]))
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    states, commands = (joints(recording, t) for t in (topics.GROUND_TRUTH, topics.EFFORT_COMMAND))
    torque = states.column("effort", "trunk")
    first, end = longest_run(torque == 0.0)
    assert end - first >= WITHOUT_TORQUE
    assert steps_without >= end - first

    # Before: the last command that got through, and held. It answers a state of two steps
    # before, or of earlier ones where the machine was busy. After: new ones, up to the end.
    got_through_ns = (first - TIMEOUT_STEPS - 2) * PERIOD_NS
    got_through = commands.column("effort", "trunk")[commands.stamp_ns <= got_through_ns]
    assert torque[first - 1] in got_through[-RATE_HZ:]
    assert torque[first - 1] != 0.0
    assert torque[end:].any()
    angle = states.column("position", "trunk")
    assert np.abs(angle[first:end]).max() > 1.0  # it fell
