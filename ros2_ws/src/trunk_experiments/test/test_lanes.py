"""Runs in lanes have the bits of separate runs; the loops over lanes are vector code."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from trunk_experiments.conformance.kit import lane_difference
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.plan import make_plan
from trunk_studies.batch import block, compiled_run
from trunk_studies.batch.block import (
    ENOUGH,
    RunSummary,
    key_of,
    regular_run,
    run_block,
    summaries,
    summary_of,
)
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.batch.lanes import LANES, ROWS, TRACED

from ...trunk_runs.test.random_plans import DISTURBED, several

EVERYWHERE = {"duration": 0.6, "update_rate": 1000.0}


def different(name, settings=(), count=LANES):
    """Return this many plans of a block: with different trunks, references, disturbances and noises."""
    slow = [f"{name}.update_rate=200.0", f"{name}.reference.profile=sine"]
    return several(name, [*slow, *settings], count, rate=1000.0)


@pytest.mark.parametrize("rate", [200.0, 600.0, 1400.0, 20_000.0])
def test_lanes_update_in_the_states_that_decide_answers(rate):
    everywhere = {"duration": 0.2, "update_rate": rate}
    settings = ["pid.update_rate=200.0", "simulator.initial.position=[0.0, 0.3]"]
    plan = make_plan("demo", "pid", settings=settings, everywhere=everywhere)
    assert regular_run(plan) is not None
    (in_a_block, *_) = summaries([plan] * ENOUGH)
    assert in_a_block == summary_of(plan)


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize("settings", [(), DISTURBED], ids=["undisturbed", "disturbed"])
@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_lane_has_the_bits_of_a_separate_run(name, settings):
    plans = different(name, settings)
    runs = [regular_run(plan) for plan in plans]
    assert len({str(key_of(run)) for run in runs}) == 1
    trace = np.empty((601, TRACED, LANES))
    found = run_block(name, runs, trace)
    assert len(set(found)) == LANES
    for lane, plan in enumerate(plans):
        table = run_compiled(plan).table
        columns = (
            table.x,
            table.theta,
            table.x_dot,
            table.theta_dot,
            table.reference,
            table.torque,
        )
        for row, column in enumerate(columns):
            assert trace[:, row, lane].tobytes() == column.tobytes(), (lane, row)
        assert found[lane] == summary_of(plan)


def test_a_lane_that_diverges_stops_alone():
    plans = different("pid")
    plans[3] = replace(plans[3], controllers={"pid": replace(plans[3].controller, d=5000.0)})
    found = run_block("pid", [regular_run(plan) for plan in plans])
    assert [lane for lane, one in enumerate(found) if one is None] == [3]
    found = summaries(plans)
    assert found == [summary_of(plan) for plan in plans]
    assert found[3].metrics is None
    assert 0.0 < found[3].diverged_at < 0.6


def test_a_fall_that_ends_its_run_leaves_the_others():
    settings = [
        "simulator.fall.stop=true",
        "simulator.fall.angle=0.42",
        "disturbance.pulse.magnitude=0.0",
    ]
    plans = different("pid", settings)
    left = [one is None for one in run_block("pid", [regular_run(plan) for plan in plans])]
    assert 0 < sum(left) < LANES
    states = [len(run_compiled(plan).table.t) for plan in plans]
    assert left == [count < 601 for count in states]
    assert 1 in states, "one begins beyond the angle"
    assert summaries(plans) == [summary_of(plan) for plan in plans]


def test_a_run_whose_law_holds_leaves_its_block():
    plan = make_plan("fig8", "pid", settings=["pid.gains.p=1e9"], everywhere=EVERYWHERE)
    plan = replace(plan, simulator=replace(plan.simulator, initial_velocity=(0.0, 1e300)))
    assert run_block("pid", [regular_run(plan)]) == [None]
    assert summaries([plan] * 5) == [summary_of(plan)] * 5


def test_runs_of_all_kinds_come_back_in_order():
    """Other rates, turns, refused plans and a few runs alone, among those that share a block."""
    plans = different("pid", count=5) + different("lqr", count=LANES + 1)
    swapped = make_plan("fig8", "pid", everywhere=EVERYWHERE, settings=["pid.active.times=[0.0]"])
    slower = make_plan("fig6", "pid", everywhere={"duration": 0.5, "update_rate": 500.0})
    endless = replace(slower, simulator=replace(slower.simulator, duration=0.0))
    mixed = [plans[0], swapped, *plans[1:9], endless, slower, *plans[9:]]
    found = summaries(mixed)
    assert found[10].refused.startswith("simulator: duration is 0")
    assert [one for i, one in enumerate(found) if i != 10] == [
        summary_of(plan) for i, plan in enumerate(mixed) if i != 10
    ]


def test_metrics_beyond_the_numbers_are_refused(monkeypatch):
    """A run whose metrics are infinite leaves its lane; alone, it says which one is too large."""

    def infinite(shape, cells, *given):
        cells[ROWS.sums * LANES :] = inf

    def beyond(table, compiled):
        raise ValueError("iae is too large for a floating-point number: no metrics")

    monkeypatch.setattr(block, "_compiled_lanes", lambda *given: infinite)
    monkeypatch.setattr(compiled_run, "metrics", beyond)
    found = summaries(different("pid"))
    assert (
        found
        == [RunSummary(None, None, "iae is too large for a floating-point number: no metrics")]
        * LANES
    )


def test_the_comparison_detects_one_changed_bit():
    plan = different("pid")[0]
    outcome = run_compiled(plan)
    assert lane_difference(plan, outcome) is None
    outcome.table.x_dot[7] *= 1.0 + 2.0**-52
    assert "step 7: x_dot is" in lane_difference(plan, outcome)


# Divisions that remain: the period by the substeps, stamps in s; twice two in a look-up of rules.
SCALAR = dict.fromkeys(CONTROLLERS, 3) | {"fuzzy_pid": 7, "fuzzy": 7}


@pytest.mark.slow
@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_loops_over_lanes_are_vector_code(name):
    """The law's update, the plant's steps, the sums: no scalar division of a lane's numbers is left.

    LLVM decides by the CPU whether that pays: here for an Intel one with AVX-512, wherever it runs.
    """
    target = {
        "NUMBA_CPU_NAME": "skylake-avx512",
        "NUMBA_CPU_FEATURES": "+avx2,+fma,+avx512f,+avx512cd,+avx512bw,+avx512dq,+avx512vl",
    }
    script = Path(__file__).with_name("lanes_code.py")
    done = subprocess.run(
        [sys.executable, script, name],
        env=os.environ | target,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    code = done.stdout
    assert len(re.findall(r"fdiv <8 x double>", code)) >= 9, "the plant's steps alone have eight"
    assert len(re.findall(r"fdiv double", code)) <= SCALAR[name], "a loop is not vector code"
    assert code.count("masked.gather") == 0, "a row is not read as a row"
