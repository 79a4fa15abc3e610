"""docs/recording.md: the program that reads a recording without this project, as printed."""

import re
from pathlib import Path

import pytest

import trunk_experiments.api as trunk

PAGE = Path(__file__).parents[1] / "docs" / "recording.md"


@pytest.mark.slow
def test_a_recording_is_read_without_this_project(tmp_path, monkeypatch, capsys):
    (program,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    assert "trunk_" not in program
    monkeypatch.chdir(tmp_path)
    run = trunk.simulate(trunk.plan("demo", duration=0.5), output="fuzzy.mcap")
    exec(program, {})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(run)
    assert lines[-1] == f"{run.t[-1]} {{'hip': {run.x[-1]}, 'trunk': {run.theta[-1]}}}"
