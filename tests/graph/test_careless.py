"""A careless user's arguments, a few for each verb; scripts/check_careless.sh tries them all."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_careless_arguments_lose_nothing_and_get_one_line() -> None:
    command = [sys.executable, "-m", "tests.careless.check", "--every", "600"]
    run = subprocess.run(
        command, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.splitlines()[-1].endswith(", 0 wrong")
