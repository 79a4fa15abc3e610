"""The commands of docs/sweep.md that branch a run work."""

import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "sweep.md"


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_the_pages_commands_work_in_order(tmp_path: Path) -> None:
    section = PAGE.read_text("utf-8").partition("## What if\n")[2].partition("\n## ")[0]
    commands = re.findall(r"^    (trunk .*)$", section, re.MULTILINE)
    assert len(commands) == 7
    for command in commands:
        subprocess.run(shlex.split(command), cwd=tmp_path, env=os.environ, check=True)
    assert len(list((tmp_path / "runs" / "branches").iterdir())) == 2
    assert len(list((tmp_path / "runs" / "limits").iterdir())) == 3
