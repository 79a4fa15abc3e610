"""A selection of hostile files, under the limits of python -m tests.hostile.check."""

import signal
import sys
from pathlib import Path

import pytest
from ros2_ws.src.trunk_experiments.test.verbs import of_recording
from ros2_ws.src.trunk_recording.test.mcap_files import raw, start

from ..finished import finished
from ..graph.processes import Child, Children, until
from . import tampered
from .check import base_run
from .corpus import unpacked
from .fuzz import readers

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_hostile_files_end_in_one_line_within_the_limits():
    # In a separate process: it forks, which a process with threads must not do.
    done = finished([sys.executable, "-m", "tests.hostile.check", "--selection"], cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 tracebacks, 0 time-outs" in done.stdout


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return base_run(tmp_path_factory.mktemp("hostile") / "base.mcap")


@pytest.mark.slow
@pytest.mark.one_in(40)
@pytest.mark.filterwarnings("error")  # they would be shown to the user
@pytest.mark.parametrize("name", tampered.FILES)
@pytest.mark.parametrize("verb", [*of_recording(Path(), Path(), Path())])
def test_one_line_at_most_of_what_a_recording_lacks(name, verb, base, tmp_path, trunk):
    path = tampered.FILES[name](base, tmp_path / "part.mcap")
    code, out, err = trunk(*of_recording(path, base, tmp_path)[verb])
    # The first of all to need a law's compiled code says so.
    beside = ("trunk: warning: ", "trunk: compiling ")
    errors = [line for line in err.splitlines() if not line.startswith(beside)]
    assert code in (0, 1, 2)
    assert len(errors) <= 1
    for line in errors:
        assert line.startswith("trunk: error: ")
        assert str(path) in line
    if code:
        assert errors or out  # it says what is wrong


def reading(child: Child, path: Path) -> bool:
    """Return True once a process has a file open."""
    try:
        return any(one.resolve() == path for one in Path(f"/proc/{child.process.pid}/fd").iterdir())
    except OSError:
        return False


@pytest.mark.graph
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
@pytest.mark.parametrize("verb", ["info", "verify", "info --check", "recover"])
def test_a_signal_ends_a_verb_in_a_long_file(children: Children, tmp_path, verb, number):
    path = tmp_path / "long.mcap"
    with path.open("wb") as file:
        file.write(start() + raw(9, length=1 << 40))
        file.truncate((1 << 40) + 100)  # a hole: it takes no room
    more = ("-o", tmp_path / "out.mcap") if verb == "recover" else ()
    child = children.trunk(*verb.split(), path, *more)
    until(lambda: reading(child, path), "it reads", 0.001)
    assert child.stop(number) == 128 + number, child.stderr
    assert child.stderr.splitlines()[-1:] == ["interrupted"]
    assert {one.name for one in tmp_path.iterdir() if "mcap" in one.name} == {"long.mcap"}


@pytest.mark.slow
@pytest.mark.one_in(4)
@pytest.mark.parametrize("part", range(4))
def test_the_fuzzers_corpus_is_read_or_refused(tmp_path, part):
    """Every file with which fuzzing reached new code: read to its end, or a TrunkError."""
    read = readers()
    files = list(unpacked())
    for data in files[part::4]:
        read(data, tmp_path / "a.mcap")
    assert len(files) > 100


STUCK = """
import hashlib
from trunk_experiments import executables
executables._end_soon()
executables.early_signals.end_by(executables._unwind)
print("stuck", flush=True)
hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)  # hours, and no handler of Python's is called in it
"""


def computed(child: Child) -> int:
    """Return a process's processor time, in ticks (10 ms)."""
    about = Path(f"/proc/{child.process.pid}/stat").read_text().rpartition(")")[2].split()
    return int(about[11])


@pytest.mark.graph
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_a_signal_ends_a_verb_that_is_stuck_in_a_library(children: Children, number):
    child = children.python(STUCK)
    until(lambda: "stuck" in child.stdout, "it is about to be", 0.001)
    before = computed(child)
    until(lambda: computed(child) > before + 20, "it computes, and thus is stuck", 0.001)
    assert child.stop(number) == 128 + number, child.stderr
    assert child.stderr == "interrupted\n"
