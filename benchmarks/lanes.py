"""Compiled runs against one another: in lanes and alone, a whole sweep and its loops, one core and two.

Ratios of times taken alternately: processor time for one process, wall time for two.
"""

from __future__ import annotations

import os
from concurrent.futures import Executor
from dataclasses import fields, replace
from time import perf_counter, sleep

import numpy as np

from trunk_control.law import ControllerConfig
from trunk_control.laws import law_named
from trunk_core.parameters.declarations import changed
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.plan import RunPlan, make_plan
from trunk_studies.batch.block import regular_run, run_block, summaries, summary_of
from trunk_studies.batch.lanes import LANES
from trunk_studies.batch.workers import worker_pool
from trunk_studies.rows import make_bases, plan_of
from trunk_studies.study import design, parse_study
from trunk_studies.sweep_execution import RunBlock
from trunk_studies.sweep_execution import run_block as run_rows

from .core import large_rules
from .harness import Row, alternately

LANES_GOAL = 3.0  # at least: a run's time alone over that in lanes
WHOLE_GOAL = 1.3  # at most: a sweep's time over that of its loops
LINEAR_GOAL = 1.15  # at most: cost per run of many over that of few
CORES_GOAL = 1.9

FEW, MANY = 64, 256  # runs

_STUDY = """
scenario: fig6
rate: 1000
set: {{simulator.substeps: 1}}
controllers: {{fuzzy_pid: {{}}}}
runs: {runs}
vary:
  trunk_mass: {{parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.4, high: 0.6}}
  angle: {{parameter: "simulator.initial.position[1]", distribution: uniform, low: -0.6, high: 0.6}}
"""


def compare(rounds: int = 3) -> list[Row]:
    """Compare compiled runs in lanes and alone, a whole sweep and its loops, one core and two."""
    return [
        *(lanes_row(name, rounds) for name in CONTROLLERS),
        size_row(rounds),
        growth_row(rounds),
        whole_row(rounds),
        cores_row(bench_plan(), rounds),
    ]


def bench_plan(controller: str = "fuzzy_pid") -> RunPlan:
    """Return the run that is timed: Fig. 6, 10 s at 1 kHz, one RK4 step per period."""
    return make_plan("fig6", controller, settings=["simulator.substeps=1"])


def varied(plan: RunPlan, count: int) -> list[RunPlan]:
    """Return this many runs, each of a different trunk."""
    simulator = plan.simulator
    masses = np.linspace(0.4, 0.6, count).tolist()
    return [
        replace(plan, simulator=changed(simulator, {"plant.trunk_mass": mass})) for mass in masses
    ]


def lanes_row(controller: str, rounds: int) -> Row:
    """Return how much faster a run in lanes is than one alone, both in compiled code, metrics included."""
    plans = varied(bench_plan(controller), FEW)
    summaries(plans)
    summary_of(plans[0])
    lanes, alone = alternately(
        rounds,
        FEW,
        lambda: summaries(plans),
        lambda: [summary_of(plan) for plan in plans],
    )
    name = f"{law_named(controller).label}: compiled run alone (theirs) / in lanes (ours)"
    return Row.of(name, lanes, alone, "ms", at_least=LANES_GOAL, inverse=True)


def size_row(rounds: int) -> Row:
    """Return the cost of a run in lanes with the largest rule base over that with the default one."""
    plan = bench_plan()
    shared = {f.name: getattr(plan.controller, f.name) for f in fields(ControllerConfig)}
    few = varied(plan, FEW)
    large = varied(plan.with_controller(replace(large_rules(), **shared)), FEW)
    for plans in (few, large):
        summaries(plans)
    ours, theirs = alternately(rounds, FEW, lambda: summaries(large), lambda: summaries(few))
    name = "a run in lanes with 64 x 64 rules (ours) / with 7 x 7 (theirs)"
    return Row.of(name, ours, theirs, "ms")


def whole_row(rounds: int) -> Row:
    """Return a sweep's time, plans, metrics and table included, over that of its bare loops."""
    study = parse_study(_STUDY.format(runs=MANY), "the benchmark's study")
    bases = make_bases(study)
    rows = RunBlock(0, study, bases, design(study, 0, study.total), "")
    columns = [
        dict(zip(rows.columns, v, strict=True)) for v in zip(*rows.columns.values(), strict=True)
    ]
    runs = [regular_run(plan_of(study, bases, row)) for row in columns]
    law = study.contenders[0].node
    blocks = [[run for run in runs[i : i + LANES] if run] for i in range(0, len(runs), LANES)]
    whole, bare = alternately(
        rounds,
        MANY,
        lambda: run_rows(rows),
        lambda: [run_block(law, block) for block in blocks],
    )
    name = f"a block of a sweep, {MANY} runs (ours) / its loops alone (theirs)"
    return Row.of(name, whole, bare, "ms", at_most=WHOLE_GOAL)


def growth_row(rounds: int) -> Row:
    """Return the cost of a run among many over that among few."""
    few, many = varied(bench_plan(), FEW), varied(bench_plan(), MANY)
    works = lambda: summaries(few), lambda: summaries(many)
    few_s, many_s = alternately(rounds, 1, *works)
    few_s, many_s = [s / FEW for s in few_s], [s / MANY for s in many_s]
    name = f"cost of one run among {MANY} (ours) / among {FEW} (theirs)"
    return Row.of(name, many_s, few_s, "ms", at_most=LINEAR_GOAL)


def cores_row(plan: RunPlan, rounds: int) -> Row:
    """Return how much faster two processes are than one; without two cores, for information only."""
    times: dict[int, list[float]] = {1: [], 2: []}
    with worker_pool(1) as single, worker_pool(2) as pair:
        pools = {1: single, 2: pair}
        for count, pool in pools.items():
            _warm_up(pool, plan, count)
        for _ in range(rounds):
            for count, pool in pools.items():
                times[count].append(_pool_time(pool, plan, count, 2 * MANY))
    name = f"{2 * MANY} runs: one core's time (theirs) / two cores' (ours)"
    row = Row.of(name, times[2], times[1], "ms", at_least=CORES_GOAL, inverse=True)
    return row if len(os.sched_getaffinity(0)) > 1 else replace(row, met=None)


def _warm_up(pool: Executor, plan: RunPlan, count: int) -> None:
    """Wait until every process of a pool has loaded its code."""
    seen: set[int] = set()
    while len(seen) < count:
        seen |= {done.result() for done in [pool.submit(_warm, plan) for _ in range(2 * count)]}


def _warm(plan: RunPlan) -> int:
    _runs(plan, 1)
    sleep(0.05)  # leaves work to the other process
    return os.getpid()


def _pool_time(pool: Executor, plan: RunPlan, count: int, runs: int) -> float:
    start = perf_counter()
    parts = 4 * count
    for done in [pool.submit(_pool_runs, plan, -(-runs // parts)) for _ in range(parts)]:
        done.result()
    return perf_counter() - start


def _pool_runs(plan: RunPlan, runs: int) -> None:
    _runs(plan, runs)


def _runs(plan: RunPlan, runs: int) -> None:
    summaries(varied(plan, runs))
