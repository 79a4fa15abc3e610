"""The checks of a soak run: planted growth, planted late steps, a broken file."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks import soak

from trunk_msgs_util.recording.joint_table import JointTable
from trunk_msgs_util.recording.reader import Recording

H = 5_000_000
NONE = np.empty((0, 0))


class Record:
    """The two topics that show a run's steps; in real time each torque is the previous answer."""

    path = "run.mcap"

    def __init__(self, steps=100):
        self.stamps = np.arange(steps + 1) * H
        self.commands = np.linspace(1.0, 2.0, steps + 1)
        self.applied = np.concatenate([[0.0], self.commands[:-1]])
        self.log = self.stamps + 17
        self.kept = np.ones(steps + 1, bool)

    def topic(self, name):
        return name

    def relative(self, name):
        return name

    def filled(self):
        return {}

    def joints(self, topic):
        if topic == "effort_command":
            stamps, log = self.stamps[self.kept], self.log[self.kept]
            return JointTable(("trunk",), stamps, log, NONE, NONE, self.commands[self.kept, None])
        effort = np.column_stack([np.zeros(len(self.stamps)), self.applied])
        return JointTable(("hip", "trunk"), self.stamps, self.log, NONE, NONE, effort)


@pytest.fixture
def record(monkeypatch):
    config = SimpleNamespace(joints=("hip", "trunk"), max_effort=1.9)
    monkeypatch.setattr(soak.RecordedRun, "config", lambda run, node: config)
    made = Record()
    made.applied = np.minimum(made.applied, 1.9)
    return made


def test_a_faultless_run(record):
    assert soak.steps_of(record) == soak.Steps(101, 0, 0, 0, 0.0)
    assert soak.problems_of_steps(soak.steps_of(record), {}, 0.005) == []


def test_late_and_idle_steps_are_found_and_must_have_been_counted(record):
    record.applied[10] = record.applied[9]
    record.applied[20:23] = 0.0
    found = soak.steps_of(record)
    assert (found.late, found.idle) == (4, 3)
    assert soak.problems_of_steps(found, {soak.LATE: 4, soak.IDLE: 3}, 0.005) == []
    late, idle = soak.problems_of_steps(found, {soak.LATE: 3, soak.IDLE: 2}, 0.005)
    assert late == "commands late: the record shows 4, /diagnostics counted 3"
    displaced = {soak.LATE: 3, soak.UNANSWERED: 1, soak.IDLE: 3}
    assert soak.problems_of_steps(found, displaced, 0.005) == []
    assert idle == "steps without a fresh command: the record shows 3, /diagnostics counted 2"


def test_before_the_first_command_there_is_no_torque_but_no_idle_step(record):
    record.applied[:4] = 0.0
    found = soak.steps_of(record)
    assert (found.late, found.idle) == (3, 0)


def test_a_state_without_a_command_must_have_been_counted(record):
    record.kept[[30, 31]] = False
    found = soak.steps_of(record)
    assert (found.unanswered, found.late) == (2, 0)
    assert soak.problems_of_steps(found, {soak.UNANSWERED: 2}, 0.005) == []
    (line,) = soak.problems_of_steps(found, {soak.UNANSWERED: 1}, 0.005)
    assert line == "states unanswered: the record shows 2, /diagnostics counted 1"


def test_lost_time_must_have_been_counted(record):
    record.log[60:] += 3_000_000_000
    found = soak.steps_of(record)
    assert found.lost_s == 3.0
    assert soak.problems_of_steps(found, {soak.OVERDUE: 600}, 0.005) == []
    (line,) = soak.problems_of_steps(found, {soak.OVERDUE: 300}, 0.005)
    assert "3.0 s longer" in line
    assert "explain 1.5 s" in line


@pytest.mark.parametrize(("slope", "grows"), [(0, False), (100, False), (2000, True)])
def test_growth(slope, grows):
    start = [(float(t), 80_000_000 + 1_000_000 * t) for t in range(20)]
    samples = start + [(float(t), 100_000_000 + slope * t) for t in range(20, 1800)]
    found = soak.growth("pid", samples, soak.settled_at(1800.0))
    assert found.ratio == pytest.approx(slope * 1650 / 1e8, rel=0.03)
    problems = soak.problems_of_memory([found])
    assert bool(problems) == grows
    assert not grows or problems[0].startswith("pid: memory grew by 3.3% from 95.")


@pytest.mark.parametrize(("slope", "grows"), [(0, False), (1900, False), (4000, True)])
def test_a_recorder_may_grow_by_its_index(slope, grows):
    samples = [(float(t), 80_000_000 + slope * t) for t in range(1800)]
    found = soak.growth("recorder", samples, soak.settled_at(1800.0))
    assert bool(soak.problems_of_memory([found])) == grows


def test_a_short_run_settles_in_its_first_half():
    assert [soak.settled_at(s) for s in (10.0, 60.0, 120.0, 1800.0)] == [5.0, 30.0, 60.0, 60.0]
    with pytest.raises(ValueError, match="pid: no sample of its memory after 5 s"):
        soak.growth("pid", [(1.0, 1), (4.9, 1)], 5.0)


@pytest.mark.slow
def test_the_file_must_be_whole(short_run, tmp_path):
    path = short_run()
    assert soak.problems_of_file(Recording.open(path)) == []
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-2000])
    (line,) = soak.problems_of_file(Recording.open(cut))
    assert line.startswith(str(cut))
    assert ": inconclusive: " in line
