"""Runs in real time whose commands came late are marked, and are never the best."""

import json
from pathlib import Path

import numpy as np
import pytest
from ros2_ws.src.trunk_experiments.test.test_doubts import fallen
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_evidence import doubts
from trunk_evidence.doubts import doubts_of
from trunk_evidence.recorded_run import Late, RecordedRun, late_steps
from trunk_runs.loop import states_of
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from .real_time import late_inputs, record_real_time

LATE = "LATE: the machine was too busy, 1 of 1300 steps late"
ADVICE = ": --lockstep gives the exact run"


def in_real_time(path: Path, late=(), count=1, **given) -> Path:
    """Record a run in real time; the command in force in some states is ``count`` steps late."""
    plan = make_plan("fig6", "pid", everywhere={"duration": 1.3}, **given)
    steps = np.zeros(states_of(plan), np.int64)
    steps[list(late)] = count
    record_real_time(plan, path, late_inputs(plan, steps))
    return path


def incomplete(source: Path, path: Path) -> Path:
    copied(source, path, lambda _: None, ANEW, {"complete": "false", "reason": "the disk is full"})
    return path


def test_a_run_that_kept_time_is_not_marked(tmp_path):
    run = RecordedRun.open(in_real_time(tmp_path / "a.mcap"))
    assert late_steps(run) == Late(0, 1300)
    found = doubts_of(run)
    assert not found
    assert found.late.moved_deg == 0.0


@pytest.mark.parametrize(("late", "count"), [((7, 8, 500), 3), ((), 0), ((300,), 1)])
def test_late_steps_are_counted(tmp_path, late, count):
    path = in_real_time(tmp_path / "a.mcap", late)
    assert late_steps(RecordedRun.open(path)) == Late(count, 1300)


def test_a_slower_controller_is_not_late(tmp_path):
    slower = {"settings": ["pid.update_rate=200.0"]}
    path = in_real_time(tmp_path / "a.mcap", **slower)
    assert late_steps(RecordedRun.open(path)) == Late(0, 1300)
    path = in_real_time(tmp_path / "b.mcap", range(100, 109), 9, **slower)
    assert late_steps(RecordedRun.open(path)) == Late(5, 1300)


def test_how_far_the_angle_was_moved(tmp_path, monkeypatch):
    path = in_real_time(tmp_path / "a.mcap", [7])
    assert doubts_of(RecordedRun.open(path), twin=False).late.moved_deg is None
    lines = doubts_of(RecordedRun.open(path)).lines
    assert lines == [f"{LATE}; in lock-step the angle differs by up to 0.00194 degrees{ADVICE}"]
    monkeypatch.setattr(doubts, "LONGEST_TWIN", 10)
    assert doubts_of(RecordedRun.open(path)).lines == [LATE + ADVICE]


def test_a_run_without_states_has_none_that_moved(tmp_path):
    def empty(messages):
        messages[:] = [m for m in messages if m[0] != "/ground_truth/joint_states"]

    copied(in_real_time(tmp_path / "a.mcap"), tmp_path / "b.mcap", empty, ANEW)
    assert doubts_of(RecordedRun.open(tmp_path / "b.mcap")).late is None


@pytest.mark.slow
def test_a_run_that_departs_from_lockstep_is_marked_even_if_no_command_was_late(tmp_path):
    run = RecordedRun.open(in_real_time(tmp_path / "a.mcap"))
    run.parameters["pid"]["gains.p"] *= 0.5
    found = doubts_of(run)
    assert found.late.steps == 0
    assert found.late.moved_deg > 1.0
    assert found


@pytest.mark.slow
def test_doubtful_runs_are_never_the_best(tmp_path, trunk):
    sound = tmp_path / "sound.mcap"
    record_offline(make_plan("fig6", "lqr", everywhere={"duration": 1.3}), sound)
    late = in_real_time(tmp_path / "late.mcap", [7])
    cut = incomplete(in_real_time(tmp_path / "whole.mcap"), tmp_path / "cut.mcap")
    down = fallen(tmp_path / "down.mcap")
    found = json.loads(trunk("compare", "--json", late, sound, cut)[1])
    assert {name for one in found["metrics"].values() for name in one["best"]} == {sound.stem}
    found = json.loads(trunk("compare", "--json", late, sound, cut, down)[1])
    assert {name for one in found["metrics"].values() for name in one["best"]} <= {sound.stem}
    doubts = [one["doubts"] for one in found["runs"]]
    assert [one["late"] and one["late"]["steps"] for one in doubts] == [1, None, 0, None]
    assert [one["complete"] for one in doubts] == [True, True, False, True]
    assert [one["fell"] for one in doubts] == [None, None, None, 0.0]
    out = trunk("compare", late, sound, cut, down)[1].splitlines()
    assert out[0].startswith("NOT RANKED: ")
    assert [line.split(":")[0] + ":" + line.split(":")[1] for line in out[1:4]] == [
        "late: LATE",
        "cut: INCOMPLETE",
        "down: FELL",
    ]
    assert trunk("compare", "--markdown", late, sound)[1].startswith("- **late: LATE: the machine")
