"""The plant's replay of runs that fall, diverge or are left alone; simulations that continue such runs."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay import replay
from trunk_experiments.replay.replay_plant import PlantReplay
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.events import Event
from trunk_sim.operator_input import with_operator
from trunk_sim.simulation import DivergedError

from ..edited import NONE, copied
from .runs import (
    MEASURED,
    MS,
    REAL_TIME,
    STATES,
    TRUTH,
    follows,
    found,
    found_by,
    of,
    planned,
    planted,
    recorded,
    stamped,
    steps,
)

pytestmark = pytest.mark.slow


def test_a_missing_fall_event_is_found_only_where_falls_are_recorded(tmp_path):
    """Recordings without the parameter report no falls."""
    plan = planned()
    simulator = replace(plan.simulator, fall_angle=0.9, initial_position=(0.0, 1.0))
    path = recorded(replace(plan, simulator=simulator), tmp_path / "fallen.mcap")

    def edit(messages):
        messages[:] = [m for m in messages if m[0] != "/run/events" or b"fell" not in m[2]]

    run = RecordedRun(copied(path, path.with_suffix(".edited"), edit, NONE))
    assert {(d.field, d.recorded, d.computed) for d in found(run)} == {("fell", 0.0, 1.0)}
    run.parameters["simulator"].pop("fall.angle")
    assert found(run) == []

    def moved(messages):
        for message in of(messages, "run/events"):
            if b"fell" in message[2]:
                stamped(message, 5 * MS)

    run = RecordedRun(copied(path, path.with_suffix(".moved"), moved, NONE))
    assert [(d.stamp_ns, d.field, d.recorded, d.computed) for d in found(run)] == [
        (0, "fell", 0.0, 1.0),
        (5 * MS, "fell", 1.0, 0.0),
    ]


def test_a_run_that_diverges_ends_with_its_last_state(tmp_path):
    plan = planned("pid.gains.d=1e5", duration=0.5)
    path = tmp_path / "diverges.mcap"
    with pytest.raises(DivergedError):
        record_offline(plan, path)
    run = RecordedRun.open(path)
    assert run.count(TRUTH) < 501
    assert found(run) == []
    assert steps(run) == run.count(TRUTH)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return a run in which nobody acts from 20 ms to 50 ms, and in which a command holds for 10 ms."""
    plan = planned(command_timeout=0.01)
    second = make_plan("fig8", "lqr", everywhere={"update_rate": 1000.0}).controllers["lqr"]
    plan = replace(
        plan,
        controllers={**plan.controllers, "lqr": replace(second, autostart=False)},
        changes={
            "pid": (Change(20 * MS, None, Event.DEACTIVATED),),
            "lqr": (Change(50 * MS, None, Event.ACTIVATED),),
        },
    )
    return recorded(plan, tmp_path_factory.mktemp("replay") / "alone.mcap")


def test_where_nobody_answers_the_last_command_holds_until_it_is_too_old(alone, way):
    assert follows(alone, way)
    run = RecordedRun.open(alone)
    assert run.count("effort_command") == STATES - 30
    torques = run.table(TRUTH).values("effort")[:, 1]
    assert len(set(torques[21:32])) == 1
    assert set(torques[32:52]) == {0.0}
    edited = planted(alone, TRUTH, 25, "effort", 1)
    assert {d.stamp_ns for d in found(edited)} == {25 * MS}


@pytest.mark.parametrize("at", [0, 1, 12, 30, 46, 59])
def test_a_simulation_goes_on_as_the_run_did(linked, pushed, alone, at):
    for path in (linked, pushed, alone):
        run = RecordedRun.open(path)
        replayed = PlantReplay(run, at * MS)
        assert found_by(replayed) == []
        simulation = replayed.resumed()
        truth, measured = run.table(TRUTH), run.table(MEASURED)
        assert [change.stamp_ns for change in replayed.to_come] == [
            one.stamp_ns for one in run.changes("simulator") if one.stamp_ns >= at * MS
        ]
        for k in range(at, min(at + 8, STATES)):
            if any(change.stamp_ns == (k - 1) * MS and k > at for change in replayed.to_come):
                break  # what happens then is left to the caller
            acting = replay.acting_at(run.table("disturbance"), k * MS)
            said, seen = simulation.truth(), simulation.measure(acting)
            for sample, table in ((said, truth), (seen, measured)):
                for quantity in ("position", "velocity", "effort"):
                    wanted = table.values(quantity)[k].tolist()
                    assert list(getattr(sample, quantity)) == wanted, (path.name, k, quantity)
            assert simulation.falls_now == any(
                e.message == Event.FELL and e.stamp_ns == k * MS for e in run.events
            )
            command = replayed._torques.command(k * MS)
            assert command is not None
            simulation.step(command, with_operator(acting, run.operated.at(k * MS)))


@pytest.mark.parametrize("provenance", [{}, REAL_TIME], ids=["exact", "real time"])
def test_states_as_recorded_are_passed_over(pushed, alone, way, provenance):
    """Except for the last state, which no step follows."""
    longest = {"step by step": 1, "by windows": 7, "by stretches": STATES - 1}[way]
    path = copied(pushed, pushed.with_suffix(".whole"), digests=NONE, provenance=provenance).path
    runs = [path] if provenance else [path, alone]
    for run in map(RecordedRun.open, runs):
        checked = list(PlantReplay(run))
        whole, rest = divmod(STATES - 1, longest)
        assert [one.steps for one in checked] == [*[longest] * whole, *[rest] * bool(rest), 1]
        for before, after in pairwise(checked):
            end = before.stamp_ns if before.last_ns is None else before.last_ns
            assert after.stamp_ns == end + MS


@pytest.mark.parametrize(
    ("substeps", "cost"), [(1, 1), (3, 1), (6, 3)], ids=["one", "three", "six"]
)
def test_when_stretches_are_worth_compiling(pushed, substeps, cost, monkeypatch):
    """A state with two Runge-Kutta steps costs as much as an update of a law."""
    run = RecordedRun.open(pushed)
    replayed, plant = PlantReplay(run), run.config("simulator").plant._replace(substeps=substeps)
    for least, worth in ((cost * STATES, True), (cost * STATES + 1, False)):
        monkeypatch.setattr(replay, "WORTH_COMPILING", least)
        assert replayed._windows.are_worthwhile(plant) is worth
