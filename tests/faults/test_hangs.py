"""Processes that hang for good: the run ends and names the process."""

import os
import re
import signal
from pathlib import Path
from typing import NamedTuple

import pytest

from trunk_recording.reader import Recording

from ..graph.peer import Peer
from ..graph.processes import Children, until
from ..graph.recordings import finished_file

pytestmark = pytest.mark.graph


class Hang(NamedTuple):
    """What processes get in turn, ``who signal``, what the run says last, and its exit code."""

    signals: tuple[str, ...]
    says: str
    options: tuple[str, ...] = ()
    recorded: int = 500  # messages before, at most five a state, and a few of the run
    code: int = 1


ALL = tuple(f"{name} STOP" for name in ("simulator", "disturbance", "fuzzy_pid", "recorder"))
HANGS = {
    # After some seconds the runner, too, knows that it has started.
    "the simulator": Hang(
        ("simulator STOP",), "the run ended because simulator has sent nothing for 20 s$", (), 3000
    ),
    "all others, and the simulator is killed": Hang(
        (*ALL[1:], "simulator KILL"), "the run ended because simulator was ended by SIGKILL"
    ),
    # The runner as well: on a busy machine it would first notice that the simulator is silent.
    "all nodes, and the runner is ended": Hang(
        ("runner STOP", *ALL, "runner TERM", "runner CONT"), "stopped by SIGTERM", code=143
    ),
    "the controller in lock-step": Hang(
        ("fuzzy_pid STOP",),
        r"simulator.*no answer.*effort_command.*lockstep\.timeout = 3 s",
        ("--lockstep", "--speed", "1", "--set", "simulator.lockstep.timeout=3"),
    ),
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.one_in(8)] * ("runner" not in name)) for name in HANGS],
)
def test_the_run_ends_and_names_the_process(
    children: Children, peer: Peer, tmp_path: Path, name: str
) -> None:
    hang = HANGS[name]
    run = children.trunk("run", "demo", "--duration", 3600, "--output", "run", *hang.options)
    peer.until_started(run)
    peer.until_recorded(hang.recorded)
    pids = {who: children.pid_of(who) for who in (word.split()[0] for word in ALL)}
    for who, number in map(str.split, hang.signals):
        pid = run.process.pid if who == "runner" else pids[who]
        os.kill(pid, getattr(signal, f"SIG{number}"))
    assert run.wait() == hang.code, run.stderr
    assert "Traceback" not in run.stderr
    children.none_left()
    assert re.match(f"trunk: error: {hang.says}", run.stderr.splitlines()[-1])
    if "recorder STOP" not in hang.signals:
        file = tmp_path / "run" / "run.mcap"
        assert finished_file(file)["/ground_truth/joint_states"] > 50
        (warning,) = Recording.open(file).warnings
        assert warning.startswith("incomplete: ")


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


@pytest.mark.one_in(8)
def test_recorder_hangs_at_the_end(children: Children, tmp_path: Path) -> None:
    run = children.trunk("run", "demo", "--duration", 2, "--output", "run")
    recorder = children.pid_of("recorder")
    log = tmp_path / "run" / "logs" / "simulator.log"
    until(lambda: log.exists() and ": finished: " in log.read_text(), "it has finished", 0.001)
    os.kill(recorder, signal.SIGSTOP)
    assert run.wait() == 1, run.stderr
    children.none_left()
    assert run.stderr.splitlines()[-1] == (
        "trunk: error: the recording is not whole: recorder did not end within 32 s and was killed"
    )
    assert not Recording.open(tmp_path / "run" / "run.mcap").complete
