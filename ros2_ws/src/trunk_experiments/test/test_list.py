"""``trunk list``: recordings, newest first, with their doubts; what is shipped, with its path."""

import json
import shutil
from functools import partial
from pathlib import Path

import pytest

from trunk_core.results import plain
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable, metrics
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.scenario import SCENARIOS

from ...trunk_recording.test.mcap_files import ANEW, copied, each


@pytest.fixture
def told(trunk):
    return partial(trunk, "list")


def test_runs(short_run, tmp_path, told, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a" / "b").mkdir(parents=True)
    shutil.copy(short_run("fig6", "pid"), "a/b/one.mcap")
    shutil.copy(short_run("fig8", "pid"), "two.mcap")
    Path("broken.mcap").write_bytes(b"nothing")
    code, out, err = told("runs")
    assert code == 0
    assert [line.count("broken.mcap") for line in err.splitlines()] == [1]
    rows = [line.split() for line in out.splitlines() if ".mcap" in line]
    assert sorted(row[0] for row in rows) == ["a/b/one.mcap", "two.mcap"]
    by_name = {row[0]: row for row in rows}
    assert by_name["two.mcap"][1:6] == ["fig8", "pid", "offline", "unjudged", "FELL"]
    assert "FELL" not in by_name["a/b/one.mcap"]
    found = json.loads(told("runs", "--json", "a")[1])["runs"]
    assert [(one["file"], one["scenario"], one["error"]) for one in found] == [
        ("a/b/one.mcap", "fig6", None)
    ]
    found = json.loads(told("runs", "--json")[1])["runs"]
    started = [one["started"] or "" for one in found]
    assert started == sorted(started, reverse=True)
    assert found[-1]["file"] == "broken.mcap"
    assert (found[-1]["error"] in err, found[-1]["doubts"]) == (True, None)


def with_another_command(source, path):
    """Copy a run with the last bit of one torque flipped."""

    def edit(topic, data, index):
        flipped = topic == "effort_command" and index == 99
        return data[:-8] + bytes([data[-8] ^ flipped]) + data[-7:]

    copied(source, path, each(edit), ANEW)


@pytest.mark.slow
def test_only_what_was_judged_has_a_verdict(short_run, tmp_path, told, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(short_run("fig6", "pid"), "good.mcap")
    with_another_command(short_run("fig6", "pid"), Path("edited.mcap"))
    found = json.loads(told("runs", "--json")[1])["runs"]
    assert {one["doubts"]["judged"] for one in found} == {None}
    assert "unjudged" in told("runs")[1]
    code, out, _ = told("runs", "--json", "--verify")
    assert code == 1
    verdicts = {one["file"]: one["doubts"]["judged"] for one in json.loads(out)["runs"]}
    assert verdicts == {"good.mcap": "verified", "edited.mcap": "diverges"}
    Path("edited.mcap").unlink()
    code, out, _ = told("runs", "--verify")
    assert code == 0
    (row,) = (line.split() for line in out.splitlines() if "good.mcap" in line)
    assert row[1:5] == ["fig6", "pid", "offline", "verified"]


def test_the_main_metrics_are_those_of_the_run(short_run, tmp_path, told):
    shutil.copy(short_run("fig6", "pid"), tmp_path / "one.mcap")
    (found,) = json.loads(told("runs", "--json", tmp_path)[1])["runs"]
    assert found["metrics"].keys() == {
        "overshoot_deg",
        "settling_time_6deg_s",
        "steady_state_error_mean_deg",
        "steady_state_error_rms_deg",
        "iae",
    }
    run = RecordedRun.open(tmp_path / "one.mcap")
    values = plain(metrics(RunTable.from_run(run)).as_dict())
    assert found["metrics"] == {name: values[name] for name in found["metrics"]}


def test_a_folder_with_metadata_is_one_run(short_run, tmp_path, told):
    bag = tmp_path / "fig8"
    bag.mkdir()
    for i in range(2):
        shutil.copy(short_run("fig8", "pid"), bag / f"part{i}.mcap")
    (bag / "metadata.yaml").write_text("")
    (found,) = json.loads(told("runs", "--json", tmp_path)[1])["runs"]
    assert found["file"] == str(bag)


def test_alone_it_says_what_can_be_listed(told):
    code, out, err = told()
    assert (code, err) == (0, "")
    assert all(f"\n  {what} " in out for what in ("runs", "scenarios", "files", "controllers"))


def test_a_scenario_is_described_in_its_line(told):
    rows = dict(line.split(maxsplit=1) for line in told("scenarios")[1].splitlines())
    assert rows["demo"].startswith("Ten seconds at 200 Hz: the trunk recovers from 30 deg")


def test_an_empty_folder_and_a_missing_one(tmp_path, told):
    assert told("runs", tmp_path)[:2] == (0, f"{tmp_path}: no recordings\n")
    code, _, err = told("runs", tmp_path / "no")
    assert (code, "there is no such folder" in err) == (2, True)


@pytest.mark.parametrize(
    ("what", "names"),
    [
        ("scenarios", set(SCENARIOS)),
        ("controllers", set(CONTROLLERS)),
        ("plants", {"trunk", "cart_pole"}),
        ("studies", {"actuator", "delay_gain", "limit_pulse", "robustness"}),
        ("files", {*SCENARIOS, "pid_as_printed"}),
        ("schemas", {"metrics-1", "error-1"}),
    ],
)
def test_what_is_shipped(told, what, names):
    code, out, _ = told(what)
    assert code == 0
    document = json.loads(told(what, "--json")[1])
    found = document[what if what in ("controllers", "plants", "schemas") else "files"]
    assert [line.split()[0] for line in out.splitlines()] == list(found)
    assert names <= found.keys()
    if "files" in document:
        assert all(Path(path).is_file() for path in found.values())
