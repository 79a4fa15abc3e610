"""The same bits without FMA, in V8 and in C; `scripts/check_portable.sh` has more environments."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from trunk_evidence.differences import diff
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.reader import Recording

from ..finished import finished
from . import cores, vectors

ROOT = Path(__file__).parents[2]
# On x86-64, glibc then takes the sine of a processor without FMA; elsewhere this changes nothing.
WITHOUT_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4"}
COUNT = 10_000  # arguments for each function


@pytest.mark.slow
def test_the_cores_without_fma():
    program = [sys.executable, "-m", "tests.portable.cores", "4000"]
    found = finished(program, cwd=ROOT, env=os.environ | WITHOUT_FMA, check=True)
    assert json.loads(found.stdout) == cores.fingerprints(4000)


@pytest.mark.slow
def test_a_recording_without_fma_is_the_same_and_verified(tmp_path):
    given = ["--set", "simulator.duration=0.9", "--set", "simulator.sensor.position_noise=0.001"]
    given += ["--controller", "fuzzy_pid", "--set", "fuzzy_pid.fuzzy.consequents=log"]
    for name, more in (("with.mcap", {}), ("without.mcap", WITHOUT_FMA)):
        command = ["trunk", "simulate", "fig6", *given, "-o", name]
        subprocess.run(command, cwd=tmp_path, env=os.environ | more, check=True)
    runs = [RecordedRun.open(tmp_path / name) for name in ("with.mcap", "without.mcap")]
    assert diff(*runs).identical
    assert verify(Recording.open(tmp_path / "without.mcap")).exit_code == VERIFIED


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("vectors")
    vectors.write(folder, COUNT)
    return folder


def said(folder, *command):
    with (folder / "vectors.txt").open() as file:
        return finished(command, cwd=folder, stdin=file).stdout.strip()


@pytest.mark.skipif(shutil.which("node") is None, reason="Node.js: for the same bits in JavaScript")
def test_javascript(folder):
    assert said(folder, "node", "vectors.js") == f"0 of {3 * COUNT} differ"


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc: for the same bits in C")
def test_c(folder):
    build = [
        "gcc",
        "-O3",
        "-march=native",
        "-ffp-contract=off",
        "vectors.c",
        "-o",
        "vectors",
        "-lm",
    ]
    subprocess.run(build, cwd=folder, check=True)
    assert said(folder, "./vectors") == f"0 of {3 * COUNT} differ"
