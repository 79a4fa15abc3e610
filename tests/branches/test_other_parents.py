"""Parents that are cut or edited: branched as far as they verify, and no further."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_core.topics import Event
from trunk_evidence.branching import Branch
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verdict_on
from trunk_evidence.recorded_run import Late, RecordedRun, late_steps
from trunk_evidence.run_table import RunTable
from trunk_recording.reader import RecordingError
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_runs.timeline import Change

from ..real_time import late_inputs, record_real_time
from ..same_bits.paths import branched_at

AT = 500_000_000  # ns
Edit = Callable[[list[list]], None]


@pytest.fixture(scope="module")
def parent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("branch") / "parent.mcap"
    record_offline(make_plan("demo", "pid", everywhere={"duration": 1.0}), path)
    return path


def branch(parent: Path, at: float, path: Path) -> RecordedRun:
    return branched_at(RecordedRun.open(parent), Branch(at), path)


@pytest.mark.slow
@pytest.mark.parametrize("topic", ["/ground_truth/joint_states", "/effort_command", "/disturbance"])
def test_a_branch_beyond_what_verifies_is_refused(parent: Path, tmp_path: Path, topic: str) -> None:
    def edit(messages: list[list]) -> None:
        for message in messages:
            if message[:2] == [topic, 300_000_000]:
                message[2] = message[2][:-8] + struct.pack("<d", 0.25)

    path = tmp_path / "edited.mcap"
    copied(parent, path, edit, ANEW)
    assert verdict_on(branch(path, 0.29, tmp_path / "a.mcap")).exit_code == VERIFIED
    why = "it cannot be branched at t = 0.5 s: it does not verify up to there: t = 0.3 s"
    with pytest.raises(RecordingError, match=why):
        branch(path, 0.5, tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


def test_removed_disturbances_before_a_branch_are_noticed(parent: Path, tmp_path: Path) -> None:
    """By its parameters, their node was not silent there."""

    def edit(messages: list[list]) -> None:
        messages[:] = [m for m in messages if m[0] != "/disturbance" or m[1] >= AT]

    branch(parent, 0.5, tmp_path / "b.mcap")
    copied(tmp_path / "b.mcap", tmp_path / "edited.mcap", edit, ANEW)
    verdict = verdict_on(RecordedRun.open(tmp_path / "edited.mcap"))
    assert verdict.exit_code != VERIFIED
    assert "disturbance: 100 steps missing, the first at t = 0 s" in verdict.obstacles


@pytest.mark.slow
def test_a_real_time_run_is_branched_after_late_commands(tmp_path: Path) -> None:
    """The last command before the branch holds until its first own one, which comes in time."""
    plan = make_plan("demo", "pid", everywhere={"duration": 1.0})
    steps = np.arange(201)
    inputs = late_inputs(plan, steps // 3 % 3, steps // 5 % 2)
    record_real_time(plan, tmp_path / "late.mcap", inputs)
    run = branch(tmp_path / "late.mcap", 0.5, tmp_path / "b.mcap")
    verdict = verdict_on(run)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    parent, late = (late_steps(r) for r in (RecordedRun.open(tmp_path / "late.mcap"), run))
    assert parent is not None
    assert late is not None
    assert 0 < late.steps < parent.steps


@pytest.mark.parametrize("timeout", [0.01, 0.3])
def test_a_timeout_of_commands_that_a_branch_changes_is_the_one_in_force(
    tmp_path: Path, timeout: float
) -> None:
    """Nobody acts from some state on: the last command holds for so long."""
    plan = make_plan("demo", "pid", everywhere={"duration": 1.0})
    plan = replace(plan, changes={"pid": [Change(AT, None, Event.DEACTIVATED)]})
    record_real_time(plan, tmp_path / "run.mcap")
    run, change = RecordedRun.open(tmp_path / "run.mcap"), f"simulator.command_timeout={timeout}"
    branched = branched_at(run, Branch(0.25, (change,)), tmp_path / "b.mcap")
    verdict = verdict_on(branched)
    assert not any(check.wrong_steps for check in verdict.checks), verdict.reasons


def test_a_file_that_ends_early_is_branched_as_far_as_it_goes(parent: Path, tmp_path: Path) -> None:
    def edit(messages: list[list]) -> None:
        messages[:] = [m for m in messages if m[1] <= 600_000_000]

    path = tmp_path / "cut.mcap"
    copied(parent, path, edit, ANEW, end=False)
    assert verdict_on(RecordedRun.open(path)).exit_code == UNJUDGED
    run = branch(path, 0.55, tmp_path / "b.mcap")
    assert verdict_on(run).exit_code == VERIFIED
    assert run.count("joint_states") == 201  # to its planned end


def test_the_reference_of_a_branch_of_another_projects_run_is_its_controllers(
    tmp_path: Path,
) -> None:
    """Up to the branch it is that of the topic."""
    parent = RecordedRun.open(Path(__file__).parents[1] / "archive" / "70f945cc_external.mcap")
    settings = ("pid.reference.profile=step", "pid.reference.step_time=2", "pid.reference.value=.3")
    run = branched_at(parent, Branch(1.0, settings, "pid"), tmp_path / "b.mcap")
    assert RunTable.from_run(run).reference.tolist() == [0.0] * 400 + [0.3] * 201


def test_a_lagging_drive_makes_no_step_late(tmp_path: Path) -> None:
    """In real time, the torque of a lagging drive is not the command, however soon that came."""
    settings = ("simulator.actuator.time_constant=0.02",)
    plan = make_plan("demo", "pid", everywhere={"duration": 1.0}, settings=settings)
    record_real_time(plan, tmp_path / "lags.mcap")
    assert late_steps(RecordedRun.open(tmp_path / "lags.mcap")) == Late(0, 200)
    record_real_time(plan, tmp_path / "late.mcap", late_inputs(plan, np.arange(201) == 100))
    assert late_steps(RecordedRun.open(tmp_path / "late.mcap")) == Late(1, 200)
