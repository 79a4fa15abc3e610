"""Runs over bad links: verified, branched, doubted and counted like runs without."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trunk_experiments.analysis.run_table import RunTable
from trunk_experiments.batch.check import first_difference
from trunk_experiments.batch.compiled_run import Batch
from trunk_experiments.branching.branch import Branch
from trunk_experiments.branching.change import branched
from trunk_experiments.branching.record import record_branch
from trunk_experiments.branching.resume import resumed, state_at
from trunk_experiments.errors import PlanError
from trunk_experiments.gym.task import make_task
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.late import Late, late_steps
from trunk_experiments.replay.verify import VERIFIED, verdict_on
from trunk_experiments.runs.offline_recording import record_offline
from trunk_experiments.runs.steps import steps
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.schemas import event

from ..edited import ANEW, copied
from ..real_time import record_real_time
from . import check

BAD = (
    "simulator.link.state.delay=12ms",
    "simulator.link.state.jitter=10ms",
    "simulator.link.state.loss=0.1",
    "simulator.link.command.jitter=8ms",
    "simulator.link.command.burst.begin=0.03",
    "simulator.link.command.burst.end=0.3",
    "simulator.link.command.order=arrival",
    "simulator.sensor.dropout=0.1",
    "simulator.sensor.position_noise=0.001",
)


def bad(seconds: float = 1.0, *more: str) -> check.RunPlan:
    return make_plan("demo", "pid", everywhere={"duration": seconds}, settings=(*BAD, *more))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("links") / "bad.mcap"
    record_offline(bad(), path)
    return path


def judged(path: Path) -> tuple[int, list[str]]:
    verdict = verdict_on(RecordedRun.open(path))
    return verdict.exit_code, [*verdict.reasons, *verdict.obstacles]


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize("index", range(6))
def test_random_links_and_drives_verify(index: int, tmp_path: Path) -> None:
    assert check.differences(check.random_plan(index, 5), tmp_path, False, ()) == []


@pytest.mark.slow
def test_compiled_code_has_the_same_links(tmp_path: Path) -> None:
    for index, plan in enumerate((bad(), bad(1.0, "simulator.link.command.missing=zero"))):
        assert check.differences(plan, tmp_path, index == 0, ()) == []
        assert first_difference(plan, Batch()) is None


def test_readings_and_commands_over_links_are_late_lost_and_held(run: Path) -> None:
    plan, found = bad(), RecordedRun.open(run)
    truth, seen = found.table("ground_truth/joint_states"), found.table("joint_states")
    assert truth.stamp_ns.tolist() == seen.stamp_ns.tolist()
    # The hip's position is measured without noise: it shows which state is seen.
    x = truth.values("position")[:, 0].tolist()
    ages = [k - x.index(value) for k, value in enumerate(seen.values("position")[:, 0].tolist())]
    assert ages == [k - j for k, j in enumerate(check.used(plan, len(x))[0])]
    assert max(ages) > 5
    commands, told = found.table("effort_command").values("effort")[:, 0], check.used(plan, 201)[1]
    applied = truth.values("effort")[1:, 1]
    assert applied.tolist() == [commands[j] if j >= 0 else 0.0 for j in told[:-1]]


@pytest.mark.slow
def test_branches_verify_and_unchanged_ones_equal_the_run(run: Path, tmp_path: Path) -> None:
    for i, at in enumerate((0.0, 0.005, 0.3331, 0.7, 1.0)):
        assert check_branch(run, Branch(at), tmp_path / f"{i}.mcap") is None
    first = check_branch(run, Branch(0.5, controller="lqr"), tmp_path / "lqr.mcap")
    assert first is not None
    assert first >= 500_000_000


def check_branch(parent: Path, branch: Branch, path: Path) -> int | None:
    """Branch a run, which verifies; return the stamp of the first difference, ns."""
    begun = RecordedRun.open(parent)
    made = branched(begun, resumed(begun, state_at(begun, branch.at)), branch, None)
    record_branch(begun, branch, made, path)
    assert judged(path) == (VERIFIED, [])
    found = diff(begun, RecordedRun.open(path)).first
    return None if found is None else found.stamp_ns


def test_resets_and_sensors_that_change_are_replayed(tmp_path: Path) -> None:
    changes = {
        "simulator": [
            Change(300_000_000, {"sensor.position_bias": 0.1, "sensor.position_noise": 0.0}),
            Change(500_000_000, None, Event.RESET),
            Change(515_000_000, {"max_effort": 20.0}),
        ]
    }
    record_offline(replace(bad(), changes=changes), tmp_path / "a.mcap")
    assert judged(tmp_path / "a.mcap") == (VERIFIED, [])


def test_sensors_that_always_fail_hold_the_first_reading(tmp_path: Path) -> None:
    record_offline(bad(0.3, "simulator.sensor.dropout=1"), tmp_path / "a.mcap")
    seen = RecordedRun.open(tmp_path / "a.mcap").table("joint_states").values("position")
    assert (seen == seen[0]).all()
    assert judged(tmp_path / "a.mcap") == (VERIFIED, [])


@pytest.mark.slow
def test_long_runs_are_checked(tmp_path: Path) -> None:
    record_offline(bad(60.0), tmp_path / "long.mcap")
    assert judged(tmp_path / "long.mcap") == (VERIFIED, [])
    checks = {
        check.name: check.steps
        for check in verdict_on(RecordedRun.open(tmp_path / "long.mcap")).checks
    }
    assert checks["states of the plant"] == checks["measured states"] == 12_001


def test_the_last_torque_is_from_the_command_that_the_link_delivers(run: Path) -> None:
    table = RunTable.of_run(RecordedRun.open(run))
    plan = bad(2.0)
    later = [step.truth.effort[1] for step in steps(plan)][1:202]
    assert table.torque.tolist() == later


def test_counts_are_recorded_and_recomputed(run: Path, tmp_path: Path) -> None:
    found = [one for one in RecordedRun.open(run).events if one.message == Event.PASSED_ON]
    assert [one.stamp_ns for one in found] == [1_000_000_000]
    values = found[0].values
    assert list(values) == ["link.state", "link.command", "sensor.dropout"]
    assert values["link.state"].startswith("201 sent, ")

    def rewrite(changed: Callable[[dict[str, str]], dict[str, str]]) -> Callable[..., None]:
        def edit(messages: list[list]) -> None:
            for message in messages:
                if b"passed on" in message[2]:
                    message[2] = event(
                        1_000_000_000, "/simulator", Event.PASSED_ON, changed(dict(values))
                    )

        return edit

    same = copied(run, tmp_path / "same.mcap", rewrite(lambda told: told), ANEW)
    assert verdict_on(RecordedRun(same)).exit_code == VERIFIED
    fewer = copied(
        run, tmp_path / "fewer.mcap", rewrite(lambda told: {**told, "sensor.dropout": "3"}), ANEW
    )
    verdict = verdict_on(RecordedRun(fewer))
    assert verdict.exit_code != VERIFIED
    assert "is not what the links' seed gives" in str([verdict.reasons, verdict.obstacles])

    def leave_out(messages: list[list]) -> None:
        messages[:] = [m for m in messages if b"passed on" not in m[2]]

    none = copied(run, tmp_path / "none.mcap", leave_out, ANEW)
    verdict = verdict_on(RecordedRun(none))
    assert verdict.exit_code != VERIFIED
    assert "'passed on' 0 times" in str([verdict.reasons, verdict.obstacles])


def test_an_edited_reading_is_found(run: Path, tmp_path: Path) -> None:
    def edit(messages: list[list]) -> None:
        for message in messages:
            if message[:2] == ["/joint_states", 700_000_000]:
                message[2] = message[2][:-24] + np.float64(0.125).tobytes() + message[2][-16:]

    path = tmp_path / "edited.mcap"
    copied(run, path, edit, ANEW)
    assert judged(path)[0] != VERIFIED


def test_in_real_time_a_link_makes_no_step_late(tmp_path: Path) -> None:
    recording = record_real_time(bad(), tmp_path / "a.mcap")
    assert late_steps(RecordedRun(recording)) == Late(0, 200)
    assert judged(tmp_path / "a.mcap") == (VERIFIED, [])


def test_an_episode_has_no_links() -> None:
    with pytest.raises(PlanError, match=r"link\.state, .* an episode has no links"):
        make_task("demo", settings=["simulator.link.state.loss=0.1"])
