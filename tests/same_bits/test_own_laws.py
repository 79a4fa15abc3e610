"""Laws of another package, with memories of their own, by every path: the bits of CPython."""

import subprocess
import sys
from pathlib import Path

import pytest
from ros2_ws.src.trunk_studies.test.cpp_device import COMPILER

from .check import with_own_laws
from .paths import IN_ONE_PROCESS

_REFUSED = "action 'gains': the constants of counting are not all floats: give 'torque'"


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++")
@pytest.mark.slow
@pytest.mark.one_in(2)
@pytest.mark.parametrize(("name", "by_gains"), [("counting", _REFUSED), ("plain", "[]")])
def test_a_law_of_ones_own_has_the_bits_of_cpython_by_every_path(
    name: str, by_gains: str, tmp_path: Path
) -> None:
    pytest.importorskip("gymnasium", reason="needs Gymnasium: requirements/gym.txt")
    done = subprocess.run(
        [sys.executable, "-m", "tests.same_bits.own_runs", name],
        env=with_own_laws(tmp_path),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    expected = {**dict.fromkeys([*IN_ONE_PROCESS, "torque", "check"], "[]"), "gains": by_gains}
    assert found == {**expected, "floquet": "True"}, done.stderr
