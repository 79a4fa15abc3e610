"""Where a run leaves its files: a folder that is made, or refused with what to give instead."""

import os
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from trunk_core import topics
from trunk_core.errors import PlanError
from trunk_experiments.cli import trunk
from trunk_recording.writer import RecordingWriter
from trunk_runs.plan import make_plan
from trunk_runs.run_files import RunFiles


def test_without_an_output_the_folder_is_made_below_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = RunFiles.for_run(make_plan("demo", "pid"))
    assert files.folder.is_dir()
    assert files.folder.parts[0] == "runs"


def test_runs_that_begin_at_once_share_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(time, "strftime", lambda *_: "20270101T000000Z")
    folders = [RunFiles.for_run(make_plan("demo", "pid")).folder for _ in range(3)]
    first = Path("runs/20270101T000000Z_demo_pid")
    assert folders == [first, Path(f"{first}_2"), Path(f"{first}_3")]


def test_where_no_folder_can_be_made_the_option_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").touch()  # as a read-only folder: no folder can be made
    with pytest.raises(PlanError, match=r"^runs/.*: give a folder with --output$"):
        RunFiles.for_run(make_plan("demo", "pid"))


@pytest.mark.parametrize("name", ["run.mcap", "params.yaml", "metadata.yaml", "logs"])
def test_existing_files_are_not_overwritten(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(PlanError, match=f"there is a {name} in it: give another folder$"):
        RunFiles.for_run(make_plan("demo", "pid"), tmp_path)
    assert (tmp_path / name).read_text() == "mine"


def test_a_name_that_ros_cannot_take_is_refused(tmp_path):
    folder = tmp_path / os.fsdecode(b"L\xe4ufe")
    with pytest.raises(
        PlanError, match=r"ufe: ROS 2 takes names in UTF-8 only: give another folder"
    ):
        RunFiles.for_run(make_plan("demo", "pid"), folder)
    assert not folder.exists()


PLAN = make_plan("demo", "pid")


def recorded(files, states=1):
    with RecordingWriter(files.recording) as writer:
        channel = writer.channel("/ground_truth/joint_states", topics.JOINT_STATE_TYPE)
        for k in range(states):
            writer.write(channel, k, k, bytes(32))
    assert files.describe() == ""


def left_by_a_run(folder):
    files = RunFiles.for_run(PLAN, folder)
    files.record(PLAN)
    recorded(files)
    files.logs.mkdir()
    files.log("pid").write_text("old")
    (folder / "notes.txt").write_text("mine")
    return files


def test_force_replaces_an_earlier_run_and_nothing_else(tmp_path):
    old = left_by_a_run(tmp_path / "run")
    with pytest.raises(PlanError, match=r"give another folder, or --force$"):
        RunFiles.for_run(PLAN, old.folder, force=False)
    assert old.recording.exists()
    new = RunFiles.for_run(PLAN, old.folder, force=True)
    assert old.recording.exists(), "nothing is touched before the run begins"
    new.log("gateway").write_text("of this run: it is served before its nodes are started")
    new.record(PLAN)
    assert not old.recording.exists()
    recorded(new)
    contents = new.recording.read_bytes()
    new.settle()
    assert names(new.folder) == WHOLE | {"logs/gateway.log"}
    assert new.recording.read_bytes() == contents


WHOLE = {"run.mcap", "params.yaml", "metadata.yaml", "logs", "notes.txt"}


def names(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.mark.parametrize("recorder", ["none", "ended", "killed"])
def test_an_earlier_recording_stays_where_the_new_run_did_not_begin(recorder, tmp_path):
    old = left_by_a_run(tmp_path / "run")
    before = {file: (old.folder / file).read_bytes() for file in WHOLE - {"logs"}}
    new = RunFiles.for_run(PLAN, old.folder, force=True)
    new.record(make_plan("fig6", "pid"))
    if recorder == "ended":
        recorded(new, states=0)
    elif recorder == "killed":
        new.recording.write_bytes(b"\x89MCAP")
    new.settle()
    assert names(new.folder) == WHOLE
    assert {file: (old.folder / file).read_bytes() for file in before} == before
    new.settle()  # there is nothing to settle any more


def test_a_description_that_cannot_be_written_is_told(tmp_path):
    files = left_by_a_run(tmp_path / "run")
    files.description.unlink()
    files.description.mkdir()
    assert files.describe() == (
        f"{files.description}: Is a directory; ROS 2's tools do not know the folder as a bag: "
        f"ros2 bag reindex {files.folder}"
    )


def test_other_files_and_open_recordings_are_not_replaced(tmp_path):
    (tmp_path / "a" / "run.mcap").mkdir(parents=True)
    odd = r"a run\.mcap in it that does not belong to a run: give another folder"
    with pytest.raises(PlanError, match=odd):
        RunFiles.for_run(PLAN, tmp_path / "a", force=True)
    (tmp_path / "b").mkdir()
    with (
        RecordingWriter(tmp_path / "b" / "run.mcap"),
        pytest.raises(PlanError, match="that is being written: give another folder, or stop"),
    ):
        RunFiles.for_run(PLAN, tmp_path / "b", force=True)
    (tmp_path / "c").write_text("mine")
    with pytest.raises(PlanError, match="it is not a folder"):
        RunFiles.for_run(PLAN, tmp_path / "c", force=True)
    assert (tmp_path / "c").read_text() == "mine"


def test_a_run_is_not_written_over_its_own_scenario(tmp_path):
    files = left_by_a_run(tmp_path / "run")
    text = files.parameters.read_text()
    words = ["run", str(files.parameters), "--output", str(files.folder), "--force"]
    done = CliRunner().invoke(trunk, words)
    assert isinstance(done.exception, PlanError)
    assert f"it is read by this command ({files.parameters})" in str(done.exception)
    assert files.parameters.read_text() == text


def test_the_root_cannot_be_a_runs_folder():
    with pytest.raises(PlanError, match="the root folder: give a folder below it"):
        RunFiles.for_run(make_plan("demo", "pid"), Path("/"))
