from dataclasses import replace

import pytest

from trunk_core.topics import Event
from trunk_evidence.recorded_run import RecordedRun
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_runs.timeline import Change


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("export-c fuzy -o c", "did you mean 'fuzzy'"),
        ("export-c pid", "--output"),
        ("export-c pid -o a.mcap", "it is not a folder"),
        ("export-c pid -o c --like missing.mcap", "missing.mcap"),
        ("export-c lqr -o c --like a.mcap", "give a recording with lqr"),
        ("export-c pid -o c --like a.mcap --set pid.gains.p=61", "gains.p = 60.0, not 61.0"),
        ("export-c pid -o c --params missing.yaml", "missing.yaml"),
        ("export-c pid -o c --set pid.gains.q=1", "gains.q"),
        ("export-c pid -o c --set lqr.u_clamp_max=3", "nothing in it is for pid: it is for lqr"),
        ("export-c pid -o c --params fuzzy_log", "give parameters of pid"),
        *(
            (f"export-c pid -o c --name={name}", f"--name {name}: allowed are up to 64 letters")
            for name in (
                "3rd",
                "int",
                "left-hip",
                "left__hip",
                "_left",
                "String",
                "replay",
                "näme",
                "",
            )
        ),
    ],
)
def test_a_mistake_is_one_line(words, line, recordings_here, command_says):
    code, out, err = command_says(*words.split())
    assert code != 0
    assert out == ""
    assert line in err
    assert err.count("\n") == 1
    assert not (recordings_here / "c").exists()


def test_a_recording_of_the_graph_says_that_its_controller_acts_from_the_start(
    command_says, tmp_path
):
    begins = Change(-1, None, Event.ACTIVATED)
    plan = make_plan("fig8", "pid", everywhere={"duration": 0.1})
    for name, changes in (
        ("begins", (begins,)),
        ("changed", (begins, Change(50_000_000, {"gains.p": 61.0}))),
    ):
        path = tmp_path / f"{name}.mcap"
        record_offline(replace(plan, changes={"pid": changes}), path)
        assert RecordedRun.open(path).plan().changes["pid"] == [*changes]
    words = "export-c", "pid", "-o", tmp_path / "c", "--like"
    code, _, err = command_says(*words, tmp_path / "changed.mcap")
    assert code == 2
    assert "pid was changed, reset or switched by hand at t = 0.05 s" in err
    code, _, err = command_says(*words, tmp_path / "begins.mcap")
    assert (code, err) == (0, "")


def test_nothing_is_overwritten_unless_asked(command_says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "c"
    folder.mkdir()
    (folder / "pid.c").write_text("mine")
    (folder / "other.c").write_text("mine")
    code, _, err = command_says("export-c", "pid", "-o", "c")
    assert code != 0
    assert "the folder is not empty: give another, or --force" in err
    assert (folder / "pid.c").read_text() == "mine"
    assert command_says("export-c", "pid", "-o", "c", "--force")[0] == 0
    assert (folder / "pid.c").read_text() != "mine"
    assert (folder / "other.c").read_text() == "mine"


def test_what_is_read_is_not_written_over_even_when_asked(command_says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = "pid:\n  ros__parameters:\n    gains.p: 61.0\n"
    (tmp_path / "pid.h").write_text(text)
    code, _, err = command_says("export-c", "pid", "--params", "pid.h", "-o", ".", "--force")
    assert (code, "pid.h: it is read by this command" in err) == (2, True)
    assert [path.name for path in tmp_path.iterdir()] == ["pid.h"]
    assert (tmp_path / "pid.h").read_text() == text
