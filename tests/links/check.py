"""Random links and drives: graph in lock-step, offline run, compiled code and replay have the same bits.

    source scripts/env.sh && python scripts/check_links.py [COUNT] [--graphs N] [--processes N] [--seed N]

All COUNT settings run offline, by CPython and by compiled code, and are verified; the first N of them in one
process of real nodes, and in a process for each node.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

from trunk_experiments.batch.random_plans import links_and_drives
from trunk_experiments.plans.plan import RunPlan, make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import VERIFIED, verdict_on
from trunk_experiments.runs.engine import states_of_run
from trunk_experiments.runs.files import RunFiles
from trunk_experiments.runs.graph import run_graph
from trunk_experiments.runs.offline_recording import record_steps
from trunk_experiments.runs.steps import steps
from trunk_msgs_util.parameters.declarations import build, values_of
from trunk_sim.config import SimulatorConfig
from trunk_sim.simulation import DivergedError
from trunk_sim.traffic import Traffic

SCENARIOS = ("demo", "fig8")
CONTROLLERS = ("pid", "fuzzy_pid", "lqr", "computed_torque")


def random_plan(index: int, seed: int) -> RunPlan:
    """Return a short run with links, and often with a real drive and real sensors."""
    rng = np.random.default_rng([seed, index])
    scenario = SCENARIOS[int(rng.integers(len(SCENARIOS)))]
    name = CONTROLLERS[int(rng.integers(len(CONTROLLERS)))]
    everywhere = {"duration": float(rng.uniform(0.2, 0.6)), "lockstep.enabled": True}
    plan = make_plan(scenario, name, everywhere=everywhere)
    drawn = links_and_drives(rng, plan.simulator.update_rate)
    values = {**values_of(plan.simulator), **drawn}
    return replace(plan, simulator=build(SimulatorConfig, values))


def used(plan: RunPlan, states: int) -> tuple[list[int], list[int]]:
    """Return which state's reading is seen, and which state's command is in use, at each state of a run."""
    traffic = Traffic(plan.simulator.network)
    return traffic.measurement_steps(states).tolist(), traffic.command_steps(states).tolist()


def differences(plan: RunPlan, folder: Path, compiled: bool, graphs: Sequence[bool]) -> list[str]:
    """Return where the ways to run a plan differ; ``graphs``: True for one process of all nodes."""
    path = folder / "cpython.mcap"
    found: list[str] = []
    try:
        record_steps(plan, steps(plan), path, tuple(plan.controllers), overwrite=True)
    except DivergedError:
        return []  # its recording is incomplete, wherever it runs
    run = RecordedRun.open(path)
    verdict = verdict_on(run)
    if verdict.exit_code != VERIFIED:
        found.append(f"{verdict.word}: {'; '.join(verdict.reasons)}")
    if compiled:
        slow = np.vstack([some.table for some in states_of_run(plan, compiled=False)])
        quick = np.vstack([some.table for some in states_of_run(plan, compiled=True)])
        wrong = np.argwhere(slow.view(np.int64) != quick.view(np.int64))
        found += [f"compiled: row and column {wrong[0]}"] if len(wrong) else []
    for composed in graphs:
        with TemporaryDirectory() as name:
            files = RunFiles(Path(name) / "graph")
            run_graph(plan, files, lambda _: None, composed=composed)
            graph = RecordedRun.open(files.recording)
            verdict, other = verdict_on(graph), diff(run, graph)
        if verdict.exit_code != VERIFIED:
            found.append(f"graph: {verdict.word}: {'; '.join(verdict.reasons)}")
        found += [] if other.identical else [f"graph: {other.describe()}"]
    return found


@click.command()
@click.argument("count", type=int, default=1000)
@click.option("--graphs", default=1000, show_default=True, help="In one process of real nodes.")
@click.option("--processes", default=30, show_default=True, help="In a process for each node.")
@click.option("--seed", default=1, show_default=True, help="Of the settings.")
def main(count: int, graphs: int, processes: int, seed: int) -> None:
    """Try COUNT random settings and print what differs; the exit code is 1 if anything does."""
    wrong = 0
    with TemporaryDirectory() as name:
        for index in range(count):
            ways = [True] * (index < graphs) + [False] * (index < processes)
            told = differences(random_plan(index, seed), Path(name), True, ways)
            wrong += bool(told)
            if told:
                print(f"setting {index}: {'; '.join(told)[:300]}", flush=True)
    print(
        f"{count} random settings offline, {min(graphs, count)} in one process of nodes, "
        f"{min(processes, count)} in a process for each: {wrong} differ"
    )
    raise SystemExit(min(wrong, 1))
