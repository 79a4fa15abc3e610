"""Every verb with closed standard streams, or readers that have left: its exit code stays what it says."""

import os
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest
from ros2_ws.src.trunk_experiments.test.verbs import Arguments, of_recording

from trunk_experiments.api import plan, simulate
from trunk_experiments.cli import OVERVIEW
from trunk_runs.processes import find_executable

from .finished import finished

pytestmark = pytest.mark.slow


def _abandoned() -> int:
    """Return the writing end of a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


# What is done to the child's streams 0, 1 and 2, by name.
STREAMS: Mapping[str, tuple[set[int], set[int]]] = {  # closed; with a reader that has left
    "stdout closed": ({1}, set()),
    "stderr closed": ({2}, set()),
    "stdin closed": ({0}, set()),
    "all closed": ({0, 1, 2}, set()),
    "stdout unread": (set(), {1}),
    "stderr unread": (set(), {2}),
    "both unread": (set(), {1, 2}),
    "stdout unread, stderr closed": ({2}, {1}),
}


def run(arguments: Arguments, closed: set[int], unread: set[int], cwd: Path) -> tuple[int, str]:
    """Run trunk so; return its exit code and what it said on the streams that are left."""

    def prepare() -> None:
        for number in unread:
            os.dup2(writing, number)
        for number in closed:
            os.close(number)

    writing = _abandoned()
    done = finished(
        [find_executable("trunk_experiments", "trunk"), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        cwd=cwd,
        preexec_fn=prepare,
    )
    os.close(writing)
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streams")
    for name in ("base", "pid"):
        simulate(plan("demo", "pid", duration=0.5), output=path / f"{name}.mcap")
    (path / "pid.mcap").write_bytes((path / "pid.mcap").read_bytes()[:-200])  # no longer sound
    return path


MISSING = "a file that is not there"
VERBS: Mapping[str, Arguments] = {
    **of_recording(Path("base.mcap"), Path("base.mcap"), Path()),
    **{
        f"{name}, broken": words
        for name, words in of_recording(Path("pid.mcap"), Path("base.mcap"), Path()).items()
        if name.split(" --j")[0] in ("verify", "info --check", "recover")
    },
    **{f"{verb} --help": (verb, "--help") for verb in OVERVIEW},
    "--version": ("--version",),
    "--help": ("--help",),
    "no arguments": (),
    "list": ("list", "scenarios"),
    "plan": ("plan", "demo", "-o", "plan.yaml", "--force"),
    "an unknown verb": ("nothing",),
    MISSING: ("verify", "--json", "nothing.mcap"),
}


@cache
def usual(name: str, folder: Path) -> int:
    """Return the exit code of a verb with its streams open and read."""
    code, said = run(VERBS[name], set(), set(), folder)
    assert "Traceback" not in said
    return code


@pytest.mark.one_in(59)
@pytest.mark.parametrize("streams", STREAMS)
@pytest.mark.parametrize("name", VERBS)
def test_the_exit_code_is_as_usual_and_nothing_else_is_said(
    folder: Path, name: str, streams: str
) -> None:
    before = (folder / "base.mcap").read_bytes()
    code, said = run(VERBS[name], *STREAMS[streams], folder)
    assert (code, "Traceback" in said, "Exception" in said) == (usual(name, folder), False, False)
    assert (folder / "base.mcap").read_bytes() == before


FULL = "trunk: error: standard output: No space left on device: free some space, or give another place\n"


@pytest.mark.parametrize(
    ("name", "stream", "said"),
    [*((name, "", FULL) for name in ("verify", "info --json", "list", "--help")), (MISSING, 2, "")],
)
def test_a_full_device_is_named(folder: Path, name: str, stream: object, said: str) -> None:
    trunk = find_executable("trunk_experiments", "trunk")
    words = ["bash", "-c", f'"$@" {stream}>/dev/full', "", trunk, *map(str, VERBS[name])]
    done = finished(words, cwd=folder)
    assert (done.returncode, done.stderr) == (2, said)


@pytest.mark.parametrize(
    "place", ["trunk_experiments.commands.verify.verdict_on", "trunk_experiments.cli.trunk"]
)
def test_a_defect_has_a_code_that_is_no_verdict(folder: Path, place: str) -> None:
    module, _, name = place.rpartition(".")
    code = f"""
import sys, {module} as module
def defect(*_, **__): raise KeyError("a defect")
module.{name} = defect
sys.argv = ["trunk", "verify", "base.mcap"]
from trunk_experiments.executables import trunk
trunk()
"""
    done = finished([sys.executable, "-c", code], cwd=folder)
    assert done.returncode == 70
    assert done.stderr.splitlines()[-1] == "KeyError: 'a defect'"
