"""The stand-in for `ros2`, and scripts/run.sh before anything is set up."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from .finished import finished

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("words", "instead"),
    [
        ("param set /pid gains.p 1.0", "trunk params set NODE NAME=VALUE"),
        ("param load /pid a.yaml", "trunk params apply NODE FILE"),
        ("param list", "trunk params NODE"),
        ("launch trunk_experiments trunk.launch.py", "trunk run SCENARIO"),
        ("bag info a", "trunk info BAG"),
        ("bag record -a", "ros2 run trunk_msgs_util recorder"),
        ("lifecycle get /pid", ""),
    ],
)
def test_a_verb_that_it_lacks_names_what_does_the_same(words: str, instead: str) -> None:
    done = finished([ROOT / "scripts/standin/ros2", *words.split()])
    shown = f": {instead} does it" if instead else ""
    assert done.returncode == 2
    assert done.stderr.startswith(
        f"ros2 (stand-in): no '{words.split()[0]}' here{shown}; it has run"
    )


def test_help_of_run_needs_no_set_up(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/run.sh", tmp_path / "scripts")
    done = finished(["bash", tmp_path / "scripts/run.sh", "--help"])
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage: scripts/run.sh SCENARIO --controller NAME")
