"""Runs over bad links: verified, branched, doubted and counted like runs without."""

from pathlib import Path

import pytest
from ros2_ws.src.trunk_runs.test.stepwise import steps

from trunk_core.errors import PlanError
from trunk_core.topics import Event
from trunk_evidence.branching import Branch
from trunk_evidence.differences import diff
from trunk_evidence.judgement import VERIFIED, verdict_on
from trunk_evidence.recorded_run import Late, RecordedRun, late_steps, links_of
from trunk_evidence.run_table import RunTable
from trunk_experiments.gym.task import make_task
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan
from trunk_sim.links import Traffic

from ..real_time import record_real_time
from ..same_bits.paths import branched_at
from ..same_bits.scenarios import LINKS, Scenario


def bad(seconds: float = 1.0, *more: str) -> RunPlan:
    return Scenario("demo", "pid", seconds, (*LINKS, *more)).plan()


def used(plan: RunPlan, states: int) -> tuple[list[int], list[int]]:
    """Return which state's reading is seen, and which state's command is in use, at each state of a run."""
    traffic = Traffic(plan.simulator.network)
    return traffic.measurement_steps(states).tolist(), traffic.command_steps(states).tolist()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("links") / "bad.mcap"
    record_offline(bad(), path)
    return path


def judged(path: Path) -> tuple[int, list[str]]:
    verdict = verdict_on(RecordedRun.open(path))
    return verdict.exit_code, [*verdict.reasons, *verdict.obstacles]


def test_readings_and_commands_over_links_are_late_lost_and_held(run: Path) -> None:
    plan, found = bad(), RecordedRun.open(run)
    truth, seen = found.table("ground_truth/joint_states"), found.table("joint_states")
    assert truth.stamp_ns.tolist() == seen.stamp_ns.tolist()
    # The hip's position is measured without noise: it shows which state is seen.
    x = truth.values("position")[:, 0].tolist()
    ages = [k - x.index(value) for k, value in enumerate(seen.values("position")[:, 0].tolist())]
    assert ages == [k - j for k, j in enumerate(used(plan, len(x))[0])]
    assert max(ages) > 5
    commands, told = found.table("effort_command").values("effort")[:, 0], used(plan, 201)[1]
    applied = truth.values("effort")[1:, 1]
    assert applied.tolist() == [commands[j] if j >= 0 else 0.0 for j in told[:-1]]


def test_a_branch_to_another_controller_verifies(run: Path, tmp_path: Path) -> None:
    parent = RecordedRun.open(run)
    branch = branched_at(parent, Branch(0.5, controller="lqr"), tmp_path / "lqr.mcap")
    assert judged(branch.path) == (VERIFIED, [])
    first = diff(parent, branch).first
    assert first is not None
    assert first.stamp_ns >= 500_000_000


def test_sensors_that_always_fail_hold_the_first_reading(tmp_path: Path) -> None:
    record_offline(bad(0.3, "simulator.sensor.dropout=1"), tmp_path / "a.mcap")
    seen = RecordedRun.open(tmp_path / "a.mcap").table("joint_states").values("position")
    assert (seen == seen[0]).all()
    assert judged(tmp_path / "a.mcap") == (VERIFIED, [])


@pytest.mark.slow
def test_long_runs_are_checked(tmp_path: Path) -> None:
    record_offline(bad(60.0), tmp_path / "long.mcap")
    verdict = verdict_on(RecordedRun.open(tmp_path / "long.mcap"))
    assert (verdict.exit_code, verdict.obstacles) == (VERIFIED, []), verdict.reasons
    checks = {check.name: check.steps for check in verdict.checks}
    assert checks["states of the plant"] == checks["measured states"] == 12_001


def test_the_last_torque_is_from_the_command_that_the_link_delivers(run: Path) -> None:
    table = RunTable.of_run(RecordedRun.open(run))
    plan = bad(2.0)
    later = [step.truth.effort[1] for step in steps(plan)][1:202]
    assert table.torque.tolist() == later


def test_counts_are_recorded_and_recomputed(run: Path) -> None:
    recorded = RecordedRun.open(run)
    (end,) = (event for event in recorded.events if event.message == Event.PASSED_ON)
    assert end.stamp_ns == 1_000_000_000
    assert list(end.values) == ["link.state", "link.command", "sensor.dropout"]
    assert end.values["link.state"].startswith("201 sent, ")
    assert links_of(recorded) == end.values


def test_in_real_time_a_link_makes_no_step_late(tmp_path: Path) -> None:
    recording = record_real_time(bad(), tmp_path / "a.mcap")
    assert late_steps(RecordedRun(recording)) == Late(0, 200)
    assert judged(tmp_path / "a.mcap") == (VERIFIED, [])


def test_an_episode_has_no_links() -> None:
    with pytest.raises(PlanError, match=r"link\.state, .* an episode has no links"):
        make_task("demo", settings=["simulator.link.state.loss=0.1"])
