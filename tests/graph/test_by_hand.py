"""Nodes started by hand, each in its own shell, as docs/running.md says; ended by Ctrl-C, in any order."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import pytest

from trunk_experiments.replay.verdict import UNJUDGED, VERIFIED
from trunk_msgs_util.recording.reader import Recording

from .peer import Peer
from .processes import Child, Children
from .recordings import finished_file

pytestmark = pytest.mark.graph

PAGE = Path(__file__).parents[2] / "docs" / "running.md"
LOCKSTEP = "lockstep.enabled:=true"
EARLY = "the recorder was stopped before the run was finished"


def commands() -> dict[str, str]:
    """Return what the page says to type, each line by the executable that it runs."""
    text = PAGE.read_text(encoding="utf-8")
    (block,) = re.findall(r"start the nodes by hand.*?```bash\n(.*?)```", text, re.DOTALL)
    lines = block.strip().splitlines()
    return {line.split("--ros-args")[0].split()[-1]: line for line in lines}


def typed(children: Children, name: str, line: str) -> Child:
    return children.start(name, "bash", "-c", line)


def ctrl_c(children: Children, shell: Child, executable: str, code: int = 0) -> None:
    """Signal the node, as a terminal does, and wait until the shell's command has ended."""
    os.kill(children.pid_of(executable), signal.SIGINT)
    assert shell.wait() == code, shell.stderr
    assert "Traceback" not in shell.stderr


def recorded_in(folder: Path) -> Path:
    (file,) = folder.glob("trunk_*.mcap")
    finished_file(file)
    return file


def verdict(children: Children, file: Path) -> tuple[int, list[str]]:
    child = children.trunk("verify", file.name, name="verify")
    return child.wait(), child.stdout.splitlines()


def test_the_commands_of_the_page_end_with_a_verified_file(
    children: Children, tmp_path: Path
) -> None:
    said = commands()
    assert list(said) == ["simulator", "recorder", "fuzzy_pid"]
    shells = {name: typed(children, name, line) for name, line in said.items()}
    assert shells["simulator"].wait() == 0, shells["simulator"].stderr
    for name in ("fuzzy_pid", "recorder"):
        ctrl_c(children, shells[name], name)
    file = recorded_in(tmp_path)
    code, lines = verdict(children, file)
    assert (code, lines[0]) == (VERIFIED, f"{file.name}: verified"), lines
    messages = sum(topic.count for topic in Recording.open(file).topics.values())
    assert (
        shells["recorder"]
        .stderr.splitlines()[-1]
        .endswith(f"recorded: {file.name}, {messages} messages, complete (finished)")
    )
    given = re.search(
        r"ended: (\d+) commands given, the last at t = 10 s", shells["fuzzy_pid"].stderr
    )
    assert given, shells["fuzzy_pid"].stderr
    assert int(given[1]) == Recording.open(file).topics["/effort_command"].count


@pytest.fixture(
    params=[pytest.param(False, marks=pytest.mark.long), True], ids=["real time", "lock-step"]
)
def endless(request: pytest.FixtureRequest, children: Children, peer: Peer) -> dict[str, Child]:
    """Start the page's three nodes for an endless run; return them once something is recorded."""
    shells = {}
    for name, line in commands().items():
        line = line.replace("duration:=10.0", "duration:=0.0")
        line += " --ros-args" * ("--ros-args" not in line)
        if request.param:
            waits = " -p wait_for:=[effort_command,recorder]" if name == "simulator" else ""
            line += f" -p {LOCKSTEP}{waits}"
        shells[name] = typed(children, name, line)
    peer.until_recorded(200, "recorder")
    return shells


def test_a_recorder_stopped_first_leaves_an_incomplete_file(
    children: Children, endless: dict[str, Child], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    ctrl_c(children, endless["recorder"], "recorder", code=1)
    if "lock-step" in request.node.callspec.id:  # the simulator waits for it, and gives up
        assert endless["simulator"].wait() == 1
        assert "no answer from /recorder" in endless["simulator"].stderr
    else:
        ctrl_c(children, endless["simulator"], "simulator")
    ctrl_c(children, endless["fuzzy_pid"], "fuzzy_pid")
    file = recorded_in(tmp_path)
    assert endless["recorder"].stderr.splitlines()[-1].endswith(f"messages, INCOMPLETE: {EARLY}")
    code, lines = verdict(children, file)
    assert code == UNJUDGED
    assert lines[:2] == [f"{file.name}: inconclusive", f"  obstacle: incomplete: {EARLY}"]
    assert sum(EARLY in line for line in lines) == 1
    assert any(line.split()[-1:] == ["verified"] for line in lines)


def test_an_endless_run_stopped_at_the_simulator_first_verifies(
    children: Children, endless: dict[str, Child], tmp_path: Path
) -> None:
    for name in ("simulator", "fuzzy_pid", "recorder"):
        ctrl_c(children, endless[name], name)
    file = recorded_in(tmp_path)
    assert verdict(children, file)[0] == VERIFIED
