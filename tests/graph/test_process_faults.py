"""Processes that die, hang or intrude, in more detail than in tests/faults."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from trunk_msgs_util.recording.reader import Recording

from .peer import Peer
from .processes import Child, Children, until
from .recordings import finished_file

pytestmark = pytest.mark.graph


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "run" / "run.mcap"


def start(children: Children, peer: Peer, *options: object) -> Child:
    """Return a run that has begun, is partly recorded, and outlives what is late on a busy machine."""
    run = children.trunk("run", "demo", "--duration", 3600, "--output", "run", *options)
    peer.until_started(run)
    peer.until_recorded(500)  # at most five a state, and a few of the run
    return run


def fails_with(children: Children, run: Child, *texts: str) -> None:
    """Assert that the run ends with code 1, a last line with these texts, and no process left."""
    assert run.wait() == 1, run.stderr
    assert "Traceback" not in run.stderr
    line = run.stderr.splitlines()[-1]
    assert line.startswith("trunk: error: ")
    for text in texts:
        assert text in line, line
    children.none_left()


def incomplete(file: Path) -> dict[str, str]:
    """Return the end record of a file that is finished, sound, and says that it is not the whole run."""
    assert finished_file(file)["/ground_truth/joint_states"] > 50
    recording = Recording.open(file)
    assert not recording.complete
    assert recording.end is not None
    (warning,) = recording.warnings
    assert warning.startswith("incomplete: ")
    return recording.end


@pytest.mark.long  # the virtual world has it, too
def test_controller_hangs_in_lockstep(children: Children, peer: Peer, file: Path) -> None:
    run = start(children, peer, "--lockstep", "--speed", 1, "--set", "simulator.lockstep.timeout=3")
    os.kill(children.pid_of("fuzzy_pid"), signal.SIGSTOP)
    fails_with(children, run, "simulator", "no answer", "effort_command", "lockstep.timeout = 3 s")
    assert "no answer" in incomplete(file)["reason"]


@pytest.mark.parametrize("when", [pytest.param("before", marks=pytest.mark.long), "during"])
def test_second_controller_is_refused(
    children: Children, peer: Peer, file: Path, when: str
) -> None:
    run = start(children, peer) if when == "during" else None
    intruder = children.node("pid")
    peer.until_up("pid")
    run = run or children.trunk("run", "demo", "--output", "run")
    until(lambda: run.process.poll() is not None, "the run ends")
    assert intruder.stop() == 0, intruder.stderr
    fails_with(
        children, run, "2 nodes publish /effort_command: /fuzzy_pid, /pid", "stop the others"
    )
    finished_file(file)
    assert not Recording.open(file).complete
