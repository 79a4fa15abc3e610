"""Where a run leaves its files: a folder that is made, or refused with what to give instead."""

from __future__ import annotations

import pytest

from trunk_experiments.errors import PlanError
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.runs.files import RunFiles


def test_without_an_output_the_folder_is_made_below_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = RunFiles.for_run(make_plan("demo", "pid"))
    assert files.folder.is_dir()
    assert files.folder.parts[0] == "runs"


def test_where_that_is_not_possible_the_option_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").touch()  # as a read-only folder: no folder can be made
    with pytest.raises(PlanError, match=r"^runs/.*: give a folder with --output$"):
        RunFiles.for_run(make_plan("demo", "pid"))


@pytest.mark.parametrize("name", ["run.mcap", "params.yaml", "metadata.yaml", "logs"])
def test_nothing_that_is_there_is_overwritten(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(PlanError, match=f"there is a {name} in it; give another folder"):
        RunFiles.for_run(make_plan("demo", "pid"), tmp_path)
    assert (tmp_path / name).read_text() == "mine"
