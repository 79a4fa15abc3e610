"""Branches without a change, at random times of different runs: each equals its parent, bit for bit.

    source scripts/env.sh && python scripts/check_branches.py [COUNT] [--seed N] [RUN.mcap ...]

Ten runs are made: eight offline, two in lock-step by real nodes; each RUN.mcap is used as well.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from trunk_experiments.branching.branch import Branch
from trunk_experiments.branching.change import branched
from trunk_experiments.branching.record import record_branch
from trunk_experiments.branching.resume import resumed, state_at
from trunk_experiments.plans.plan import RunPlan, make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.plans.turns import Swap
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import VERIFIED, verdict_on
from trunk_experiments.runs.files import RunFiles
from trunk_experiments.runs.graph import run_graph
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.units import seconds

SHORT = {"duration": 1.5}


def plans() -> dict[str, RunPlan]:
    """Return the plans of runs that differ in what a branch has to remember."""
    demo = make_plan("demo", "fuzzy_pid", everywhere=SHORT)
    fig8 = make_plan("fig8", "pid", everywhere={"duration": 1.2})
    turns = [Change(0, None, Event.DEACTIVATED), Change(400_000_000, None, Event.ACTIVATED)]
    return {
        "fuzzy": make_plan("fig8", "fuzzy_pid", everywhere={"duration": 1.2}),
        "noise_and_delay": make_plan(
            "demo",
            "pid",
            everywhere=SHORT,
            settings=(
                "simulator.sensor.position_noise=0.002",
                "simulator.sensor.velocity_noise=0.01",
                "simulator.sensor.delay=0.035",
            ),
        ),
        "swaps": make_plan(
            "demo",
            "pid",
            everywhere=SHORT,
            swaps=(Swap(0.4, "fuzzy_pid"), Swap(0.9, "lqr"), Swap(1.2, "pid")),
        ),
        "slow_controller": make_plan(
            "demo",
            "computed_torque",
            everywhere=SHORT,
            settings=("computed_torque.update_rate=50",),
        ),
        "disturbed": make_plan(
            "demo",
            "lqr",
            everywhere=SHORT,
            settings=(
                "disturbance.noise.rms=3",
                "disturbance.sine.amplitude=20",
                "disturbance.pulse.start_times=[0.3, 0.8]",
            ),
        ),
        "retuned": replace(
            demo,
            changes={
                "fuzzy_pid": [
                    Change(250_000_000, {"u_clamp_max": 30.0}),
                    Change(700_000_000, None, Event.RESET),
                ],
                "simulator": [
                    Change(500_000_000, {"max_effort": 12.0}),
                    Change(900_000_000, None, Event.RESET),
                ],
            },
        ),
        "by_hand": replace(fig8, changes={"pid": turns}),
        "falls": make_plan("fig7", "pid", everywhere={"duration": 1.2}),
    }


def parents(folder: Path) -> Iterator[Path]:
    """Record the runs, one after the other."""
    for name, plan in plans().items():
        path = folder / f"{name}.mcap"
        record_offline(plan, path)
        yield path


def graph_parents(folder: Path) -> Iterator[Path]:
    """Record runs in lock-step by the real nodes."""
    swaps = (Swap(0.6, "fuzzy_pid"),)
    for name, plan in (
        (
            "lockstep",
            make_plan("fig8", "fuzzy_pid", everywhere={**SHORT, "lockstep.enabled": True}),
        ),
        (
            "lockstep_swap",
            make_plan("demo", "pid", everywhere={**SHORT, "lockstep.enabled": True}, swaps=swaps),
        ),
    ):
        files = RunFiles(folder / name)
        run_graph(plan, files, lambda _: None, composed=True)
        yield files.recording


def differences(path: Path, at: float, folder: Path) -> list[str]:
    """Return how a branch at a given time, without a change, differs from its parent."""
    run = RecordedRun.open(path)
    begun = resumed(run, state_at(run, at))
    branch = Branch(at)
    out = folder / "branch.mcap"
    record_branch(run, branch, branched(run, begun, branch, None), out, overwrite=True)
    found = RecordedRun.open(out)
    compared = diff(run, found)
    told = [] if compared.identical else [compared.describe()]
    told += [*compared.parameters, *compared.record]
    for relative in (topics.RUN_EVENTS, topics.RUN_PARAMETERS):
        if run.count(relative) != found.count(relative):
            told.append(f"{relative}: {run.count(relative)} messages, {found.count(relative)}")
    verdict = verdict_on(found)
    if verdict.exit_code != VERIFIED:
        told.append(f"{verdict.word}: {'; '.join(verdict.reasons)}")
    return told


def time_in(path: Path, random_: random.Random) -> float:
    """Return a random time within a run, s; one time in fifty it is an end of the run."""
    last = seconds(int(RecordedRun.open(path).table(topics.GROUND_TRUTH).stamp_ns.max()))
    return random_.choice((0.0, last)) if random_.random() < 0.02 else random_.uniform(0.0, last)


@click.command()
@click.argument("count", type=int, default=1000)
@click.option("--seed", default=1, help="Of the times.")
@click.argument("runs", nargs=-1, type=click.Path(path_type=Path, exists=True))
def main(count: int, seed: int, runs: Sequence[Path]) -> None:
    """Branch runs at COUNT random times, and print what differs; the exit code is 1 if anything does."""
    random_ = random.Random(seed)
    wrong = 0
    with TemporaryDirectory() as name:
        folder = Path(name)
        some = [*runs, *parents(folder), *graph_parents(folder)]
        for i in range(count):
            path = some[i % len(some)]
            at = time_in(path, random_)
            told = differences(path, at, folder)
            wrong += bool(told)
            if told:
                print(
                    f"{path.parent.name}/{path.name}, t = {at!r} s: {'; '.join(told)[:300]}",
                    flush=True,
                )
    print(
        f"{count} branches of {len(some)} runs without a change: {wrong} differ from their parents"
    )
    raise SystemExit(min(wrong, 1))
