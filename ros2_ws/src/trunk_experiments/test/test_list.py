"""``trunk list``: recordings, newest first, with their doubts; what is shipped, with its path."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest

from trunk_experiments.cli import main
from trunk_experiments.plans.files import SCENARIOS
from trunk_experiments.plans.nodes import CONTROLLERS


@pytest.fixture
def told(monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr(sys, "argv", ["trunk", "list", *map(str, words)])
        with pytest.raises(SystemExit) as stop:
            main()
        captured = capsys.readouterr()
        return stop.value.code, captured.out, captured.err

    return run


def test_runs(short_run, tmp_path, told, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a" / "b").mkdir(parents=True)
    shutil.copy(short_run("fig6", "pid"), "a/b/one.mcap")
    shutil.copy(short_run("fig8", "pid"), "two.mcap")
    Path("broken.mcap").write_bytes(b"nothing")
    code, out, err = told("runs")
    assert code == 0
    assert "broken.mcap: " in err
    rows = [line.split() for line in out.splitlines() if ".mcap" in line]
    assert sorted(row[0] for row in rows) == ["a/b/one.mcap", "two.mcap"]
    by_name = {row[0]: row for row in rows}
    assert by_name["two.mcap"][1:5] == ["fig8", "pid", "offline", "FELL"]
    assert "FELL" not in by_name["a/b/one.mcap"]
    found = json.loads(told("runs", "--json", "a")[1])
    assert [(one["path"], one["scenario"], one["error"]) for one in found] == [
        ("a/b/one.mcap", "fig6", "")
    ]
    started = [one["started"] for one in json.loads(told("runs", "--json")[1])]
    assert started == sorted(started, reverse=True)


def test_a_folder_with_metadata_is_one_run(short_run, tmp_path, told):
    bag = tmp_path / "fig8"
    bag.mkdir()
    for i in range(2):
        shutil.copy(short_run("fig8", "pid"), bag / f"part{i}.mcap")
    (bag / "metadata.yaml").write_text("")
    (found,) = json.loads(told("runs", "--json", tmp_path)[1])
    assert found["path"] == str(bag)


def test_nothing_and_nowhere(tmp_path, told):
    assert told("runs", tmp_path)[:2] == (0, f"{tmp_path}: no recordings\n")
    code, _, err = told("runs", tmp_path / "no")
    assert (code, "there is no such folder" in err) == (2, True)


@pytest.mark.parametrize(
    ("what", "names"),
    [
        ("scenarios", set(SCENARIOS)),
        ("controllers", set(CONTROLLERS)),
        ("studies", {"delay_gain", "limit_pulse", "robustness"}),
        ("files", {*SCENARIOS, "pid_as_printed"}),
    ],
)
def test_what_is_shipped(told, what, names):
    code, out, _ = told(what)
    assert code == 0
    found = json.loads(told(what, "--json")[1])
    assert [line.split()[0] for line in out.splitlines()] == list(found)
    assert names <= found.keys()
    if what != "controllers":
        assert all(Path(path).is_file() for path in found.values())
