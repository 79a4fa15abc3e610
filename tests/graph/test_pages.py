"""The commands of the pages, word for word and in order, in an empty folder."""

import os
import re
import signal
from contextlib import closing
from pathlib import Path

import pytest

from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording
from trunk_runs.nodes import CONTROLLERS

from .peer import Peer
from .processes import Child, Children, until
from .recordings import finished_file

pytestmark = pytest.mark.graph

ROOT = Path(__file__).parents[2]


def page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text("utf-8")


def shell(children: Children, text: str, language: str = "bash") -> Child:
    """Begin the commands of a text in a shell, in a folder with the examples."""
    commands = re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert commands
    (children.folder / "examples").symlink_to(ROOT / "examples")
    script = children.folder / "page.sh"
    script.write_text(f"set -e\n{''.join(commands)}", "utf-8")
    return children.start("page", "bash", script)


def said(begun: Child) -> str:
    """Return what the commands print, none of which fails."""
    assert begun.wait() == 0, begun.stdout + begun.stderr
    return begun.stdout


def test_nodes_started_by_hand_end_with_a_verified_file(children: Children, tmp_path: Path) -> None:
    """Each in its own shell, ended by Ctrl-C, as a terminal sends it."""
    (block,) = re.findall(
        r"start the nodes by hand.*?```bash\n(.*?)```", page("running"), re.DOTALL
    )
    lines = {line.split("--ros-args")[0].split()[-1]: line for line in block.strip().splitlines()}
    assert list(lines) == ["simulator", "recorder", "fuzzy_pid"]
    shells = {name: children.start(name, "bash", "-c", line) for name, line in lines.items()}
    assert shells["simulator"].wait() == 0, shells["simulator"].stderr
    for name in ("fuzzy_pid", "recorder"):
        os.kill(children.pid_of(name), signal.SIGINT)
        assert shells[name].wait() == 0, shells[name].stderr
        assert "Traceback" not in shells[name].stderr
    (file,) = tmp_path.glob("trunk_*.mcap")
    finished_file(file)
    recording = Recording.open(file)
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    messages = sum(topic.count for topic in recording.topics.values())
    last = f"recorded: {file.name}, {messages} messages, complete (finished)"
    assert shells["recorder"].stderr.splitlines()[-1].endswith(last)
    commands = recording.topics["/effort_command"].count
    assert f"ended: {commands} commands given, the last at t = 10 s" in shells["fuzzy_pid"].stderr


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_tutorial(children: Children, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    promised = ("first.mcap: verified", "identical: 10006 messages, bit for bit")
    for line in promised:
        assert f"    {line}\n" in page("tutorial")
    (tmp_path / "biped-trunk").symlink_to(ROOT)
    monkeypatch.setenv("BROWSER", "true")  # for a user a browser opens; here none does
    begun = shell(children, page("tutorial"))
    until(lambda: "to watch only: http" in begun.stdout or not begun.alive, "the live page")
    with closing(Peer()) as peer:  # not before: the run in lock-step is over
        peer.until_started(begun)
        peer.until_recorded(200, "recorder")

    def live() -> list[int]:
        return [pid for pid, line in children.pids().items() if " live demo " in f"{line} "]

    os.kill(until(live, "trunk live")[0], signal.SIGINT)
    text = said(begun)
    for line in promised:
        assert line in text
    made = {path.name for path in (tmp_path / "tutorial").iterdir()}
    assert {"first.html", "rules.mcap", "rules.html", "own.mcap", "study.parquet"} <= made
    assert text.count(": verified\n") == 2


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_rules(children: Children, tmp_path: Path) -> None:
    pytest.importorskip("fuzzylite", reason="needs pyfuzzylite: requirements/fuzzy.txt")
    text = said(shell(children, page("rules")))
    (sampled,) = re.findall(r"^    (examples/rules/.* sampled: .*)$", page("rules"), re.MULTILINE)
    assert sampled in text
    assert text.count(": verified\n") == 2
    assert "identical: " in text
    assert (tmp_path / "again.yaml").read_text() == (tmp_path / "rules.yaml").read_text()


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_a_node_of_ones_own(children: Children) -> None:
    section = page("controllers").partition("### From nothing to a comparison")[2]
    text = said(shell(children, section.partition("\n### ")[0]))
    assert "mine: verified" in text
    assert "commands of my_pd" in text
    assert "NOT RANKED" not in text


@pytest.mark.one_in(8)
def test_a_controller_of_ones_own(children: Children, peer: Peer, tmp_path: Path) -> None:
    name = "my_controller"
    assert name not in CONTROLLERS
    text = said(shell(children, page("controllers"), "sh"))
    assert f"({name}): 19 of 20 kept, 1 noted" in text  # its default file has the former slope
    assert text.count(": verified\n") == 4
    assert "100 runs: 100 ok, 0 diverged, 0 refused" in text
    assert "20 passed" in text
    workspace = tmp_path / "my_ws"
    law = workspace / "src" / name / name / "law.py"
    assert len(law.read_text("utf-8").splitlines()) <= 40

    in_workspace = f"cd {workspace} && source install/setup.bash && "
    same = in_workspace + "trunk diff lockstep composed; trunk diff lockstep mine.mcap"
    differences = children.start("diff", "bash", "-c", same)
    differences.wait()
    assert differences.stdout.count("identical: 10006 messages, bit for bit\n") == 2

    # By another name than in the page's runs, whose last messages may still arrive.
    alone = f"exec ros2 run {name} {name} --ros-args -r __node:=alone"
    node = children.start("node", "bash", "-c", in_workspace + alone)
    peer.until_event("alone", "activated")
    assert node.stop() == 0, node.stderr


@pytest.mark.one_in(8)
def test_a_plant_of_ones_own(children: Children, tmp_path: Path) -> None:
    text = said(shell(children, page("plant"), "sh"))
    assert "My plant (my_plant): " in text
    assert "NOT KEPT" not in text
    assert text.count(": verified\n") == 3
    assert " passed" in text
    workspace = tmp_path / "my_ws"
    same = f"cd {workspace} && source install/setup.bash && trunk diff lockstep mine.mcap"
    difference = children.start("diff", "bash", "-c", same)
    difference.wait()
    assert "bit for bit\n" in difference.stdout
