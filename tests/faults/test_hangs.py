"""Processes that hang for good: the run ends and names the process."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from trunk_msgs_util.recording.reader import Recording

from ..graph.peer import Peer
from ..graph.processes import Children, until
from ..graph.recordings import finished_file

pytestmark = pytest.mark.graph


@pytest.mark.long
def test_simulator_hangs_in_real_time(children: Children, peer: Peer, tmp_path: Path) -> None:
    run = children.trunk("run", "demo", "--duration", 3600, "--output", "run")
    peer.until_started(run)
    peer.until_recorded(3000)  # some seconds: the runner, too, knows by then that it has started
    os.kill(children.pid_of("simulator"), signal.SIGSTOP)
    assert run.wait() == 1, run.stderr
    children.none_left()
    line = run.stderr.splitlines()[-1]
    assert line == "trunk: error: the run ended because simulator has sent nothing for 5 s"
    assert finished_file(tmp_path / "run" / "run.mcap")["/joint_states"] > 20
    assert not Recording.open(tmp_path / "run" / "run.mcap").complete


@pytest.mark.long
def test_simulator_is_killed_while_all_others_hang(children: Children, peer: Peer) -> None:
    run = children.trunk("run", "demo", "--duration", 3600, "--output", "run")
    peer.until_started(run)
    for name in ("disturbance", "fuzzy_pid", "recorder"):
        os.kill(children.pid_of(name), signal.SIGSTOP)
    os.kill(children.pid_of("simulator"), signal.SIGKILL)
    assert run.wait() == 1, run.stderr
    children.none_left()
    line = run.stderr.splitlines()[-1]
    assert line.startswith("trunk: error: the run ended because simulator was ended by SIGKILL")


def test_all_nodes_hang_and_the_runner_gets_sigterm(children: Children, peer: Peer) -> None:
    run = children.trunk("run", "demo", "--duration", 3600, "--output", "run")
    peer.until_started(run)
    # The runner as well: on a busy machine it would first notice that the simulator is silent.
    os.kill(run.process.pid, signal.SIGSTOP)
    for name in ("simulator", "disturbance", "fuzzy_pid", "recorder"):
        os.kill(children.pid_of(name), signal.SIGSTOP)
    for number in (signal.SIGTERM, signal.SIGCONT):
        os.kill(run.process.pid, number)
    assert run.wait() == 1
    children.none_left()
    assert run.stderr.splitlines()[-1].startswith("trunk: error: stopped by SIGTERM")


def test_ctrl_c_comes_before_a_runner_that_hung_knows_of_the_start(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    run = children.trunk("live", "--no-browser", "--output", "run")
    children.pid_of("simulator")
    os.kill(run.process.pid, signal.SIGSTOP)
    peer.until_event("simulator", "started")
    peer.until_recorded(200)
    for number in (signal.SIGINT, signal.SIGCONT):
        os.kill(run.process.pid, number)
    assert run.wait() == 0, run.stderr
    assert Recording.open(tmp_path / "run" / "run.mcap").complete


@pytest.mark.long
def test_recorder_hangs_at_the_end(children: Children, tmp_path: Path) -> None:
    run = children.trunk("run", "demo", "--duration", 2, "--output", "run")
    recorder = children.pid_of("recorder")
    log = tmp_path / "run" / "logs" / "simulator.log"
    until(lambda: log.exists() and ": finished: " in log.read_text(), "it has finished", 0.001)
    os.kill(recorder, signal.SIGSTOP)
    assert run.wait() == 1, run.stderr
    children.none_left()
    assert run.stderr.splitlines()[-1] == (
        "trunk: error: the recording is not whole: recorder did not end within 8 s and was killed"
    )
    assert not Recording.open(tmp_path / "run" / "run.mcap").complete
