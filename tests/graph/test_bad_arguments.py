"""Some twenty bad arguments; python -m tests.hostile.arguments tries them all with every verb."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from ..finished import finished

# `trunk run` is among the verbs: in this folder each test has its own ROS domain.
pytestmark = [pytest.mark.graph, pytest.mark.slow]


def test_bad_arguments_lose_nothing_and_get_one_line() -> None:
    command = [sys.executable, "-m", "tests.hostile.arguments", "--every", "397"]
    run = finished(command, cwd=Path(__file__).parents[2])
    assert run.returncode == 0, run.stdout + run.stderr
    cases = run.stdout.splitlines()[-1]
    assert cases.endswith(", 0 wrong")
    assert int(cases.split()[0]) >= 19
