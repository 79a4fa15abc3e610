"""Branches without a change are their parents at any time; the commands of docs/branch.md work."""

from __future__ import annotations

import os
import random
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from . import check

PAGE = Path(__file__).parents[2] / "docs" / "branch.md"


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", check.plans())
def test_an_unchanged_branch_equals_its_parent(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.mcap"
    check.record_offline(check.plans()[name], path)
    random_ = random.Random(name)
    for at in (0.0, *(check.time_in(path, random_) for _ in range(2))):
        assert check.differences(path, at, tmp_path) == []


@pytest.mark.slow
def test_the_pages_commands_work_in_order(tmp_path: Path) -> None:
    commands = re.findall(r"^    (trunk .*)$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert len(commands) == 7
    for command in commands:
        subprocess.run(shlex.split(command), cwd=tmp_path, env=os.environ, check=True)
    assert len(list((tmp_path / "runs" / "branches").iterdir())) == 2
    assert len(list((tmp_path / "runs" / "limits").iterdir())) == 3
