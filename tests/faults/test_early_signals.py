"""Signals to a program that is still loading, and Ctrl-C to ``trunk`` at any instant."""

import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import distributions
from pathlib import Path

import pytest

from trunk_runs.nodes import NODES as KINDS
from trunk_runs.processes import find_executable

from ..finished import finished
from ..graph import forked
from ..graph.processes import Child, Children, until

pytestmark = pytest.mark.graph

NUMBERS = [signal.SIGINT, signal.SIGTERM]
NODES = ("simulator", "disturbance", "fuzzy_pid", "recorder")


def has_begun(children: Children, child: Child) -> bool:
    """Return True once the child runs its own program: from then on no signal is lost."""
    return "python" in children.pids().get(child.process.pid, "").split(" ")[0]


def has_loaded(child: Child, library: str) -> bool:
    """Return True once the process has mapped a shared library: it is in the middle of its imports."""
    with suppress(OSError):
        return library in Path(f"/proc/{child.process.pid}/maps").read_text()
    return False


@pytest.mark.parametrize("number", NUMBERS, ids=lambda number: number.name)
@pytest.mark.parametrize("library", ["", "_rclpy_pybind11"], ids=["begun", "importing rclpy"])
def test_node_ends_silently(children: Children, tmp_path: Path, library: str, number: int) -> None:
    for name in NODES:
        child = children.start(name, find_executable(KINDS[name].package, name))
        if library:
            until(lambda child=child: has_loaded(child, library), "it imports rclpy", 0.001)
        else:
            until(lambda child=child: has_begun(children, child), "it has begun", 0.001)
        code = child.stop(number)
        said = (child.stdout + child.stderr).splitlines()
        if name == "recorder" and said == [
            "recorder: stopped while it was loading: nothing is recorded"
        ]:
            assert code == 1
            continue
        # On a busy machine the signal may come late, to a node that is up and says so.
        assert said or name != "recorder"
        assert code == 0, said
        assert all(line.startswith(("[INFO] ", "[WARN] ")) for line in said), said
        assert said or not list(tmp_path.glob("*.mcap"))


def test_a_node_that_is_done_does_not_unload_what_it_loaded(tmp_path: Path) -> None:
    """Else the recorder, which is told to end when all others have ended, would wait for that."""
    module = "import atexit, os, sys\ndef main(): atexit.register(os._exit, 9); print('said'); sys.exit(3)"
    (tmp_path / "done_node.py").write_text(module)
    executable = "from trunk_msgs_util.node import early_signals; early_signals.node('done_node')()"
    done = finished([sys.executable, "-c", executable], cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (3, "said\n", "")


def test_copies_begin_with_signals_blocked(children: Children) -> None:
    """Else one that comes before the executable's first line would end it with code 1, without a word."""
    for index in range(6):
        child = children.node("pid", name=f"pid{index}")
        assert child.stop() == 0, child.stderr
    status = Path(f"/proc/{forked.server()}/status").read_text()
    blocked = int(status.partition("SigBlk:")[2].split()[0], 16)
    assert all(blocked >> (number - 1) & 1 for number in NUMBERS)


def test_copies_of_tests_in_the_background_lose_no_signal(children: Children) -> None:
    """A background job begins with SIGINT ignored: where its copies did, too, most lost an early one."""
    test = f"{__file__}::{test_copies_begin_with_signals_blocked.__name__}"
    job = 'trap "" INT; cd "$1"; exec "$2" -m pytest -p no:cacheprovider "$3"'
    tests = children.start("tests", "bash", "-c", job, "", Path.cwd(), sys.executable, test)
    assert tests.wait() == 0, tests.stdout


def simulating(child: Child) -> bool:
    return any(path.stat().st_size > 0 for path in child.folder.glob(".out.*.mcap"))


@pytest.mark.parametrize("number", NUMBERS, ids=lambda number: number.name)
@pytest.mark.parametrize(
    "instant",
    [None, lambda child: has_loaded(child, "numpy"), simulating],
    ids=["begun", "importing numpy", "writing"],
)
def test_trunk_says_one_line(
    children: Children,
    tmp_path: Path,
    instant: Callable[[Child], bool] | None,
    number: signal.Signals,
) -> None:
    trunk = find_executable("trunk_experiments", "trunk")
    child = children.start("trunk", trunk, "simulate", "demo", "--duration", 3600, "-o", "out.mcap")
    until(lambda: instant(child) if instant else has_begun(children, child), "the instant", 0.001)
    assert child.stop(number) == 128 + number
    assert (child.stdout, child.stderr) == ("", "interrupted\n")
    assert [path.name for path in tmp_path.glob("*out*.mcap")] == []


def test_every_executable_takes_signals_early() -> None:
    scripts = {
        entry.name: entry.value
        for found in distributions()
        if found.metadata["Name"].replace("-", "_").startswith("trunk_")
        for entry in found.entry_points
        if entry.group == "console_scripts"
    }
    assert {*NODES, "trunk", "composed", "markers"} <= set(scripts)
    late = {name: value for name, value in scripts.items() if ".executables:" not in value}
    assert late == {}, "signals are held back from these until early_signals.end_by"
