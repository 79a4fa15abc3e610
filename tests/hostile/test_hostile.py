"""A selection of hostile files, under the limits of scripts/check_hostile.sh."""

from __future__ import annotations

import signal
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from ..graph.processes import Child, Children, until
from .corpus import ARCHIVE
from .fuzz import readers
from .mcap_bytes import MAGIC, header

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_hostile_files_end_in_a_line_within_the_limits():
    # A process of its own: it forks, which a process with threads must not.
    done = subprocess.run(
        [sys.executable, "-m", "tests.hostile.check", "--selection"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 tracebacks, 0 time-outs" in done.stdout


def reading(child: Child, path: Path) -> bool:
    """Return True once a process has a file open."""
    try:
        return any(one.resolve() == path for one in Path(f"/proc/{child.process.pid}/fd").iterdir())
    except OSError:
        return False


@pytest.mark.graph
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
@pytest.mark.parametrize("verb", ["info", "verify", "doctor", "recover"])
def test_a_signal_ends_a_verb_in_a_long_file(children: Children, tmp_path, verb, number):
    path = tmp_path / "long.mcap"
    with path.open("wb") as file:
        file.write(MAGIC + header() + struct.pack("<BQ", 9, 1 << 40))
        file.truncate((1 << 40) + 100)  # a hole: it takes no room
    more = ("-o", tmp_path / "out.mcap") if verb == "recover" else ()
    child = children.trunk(verb, path, *more)
    until(lambda: reading(child, path), "it reads", 0.001)
    assert child.stop(number) == 128 + number, child.stderr
    assert child.stderr.splitlines()[-1:] == ["interrupted"]
    assert {one.name for one in tmp_path.iterdir() if "mcap" in one.name} == {"long.mcap"}


def test_the_fuzzers_corpus_is_read_or_refused(tmp_path):
    """Every file with which fuzzing reached new code: read to its end, or a TrunkError."""
    read = readers()
    with zipfile.ZipFile(ARCHIVE) as packed:
        names = packed.namelist()
        for name in names:
            read(packed.read(name), tmp_path / "a.mcap")
    assert len(names) > 50
