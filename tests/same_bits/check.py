"""Many plans by every path, bit by bit:

    source scripts/env.sh && python -m tests.same_bits.check [COUNT] [--path PATH] [--graphs N] [--busy]

The scenarios of tests/same_bits, the figures with their controllers, COUNT random plans over every declared
parameter and as many with random links; the first N of each kind by the real nodes, too.
"""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from ros2_ws.src.trunk_experiments.test.random_plans import random_plan

from trunk_experiments.batch.check import first_difference
from trunk_experiments.batch.compiled_run import Batch
from trunk_experiments.errors import PlanError
from trunk_experiments.plans.plan import RunPlan, make_plan

from .paths import IN_ONE_PROCESS, PATHS, differences, reference
from .scenarios import SCENARIOS, random_links

_FIGURES = ("fig6", "fig7", "fig8", "fig9")
_CONTROLLERS = (
    ("pid", "pid_ziegler_nichols"),
    ("pid", "pid_as_printed"),
    ("fuzzy_pid", "fuzzy_as_printed"),
    ("lqr", "profile_practical"),
    ("computed_torque", "profile_practical"),
)
_LOCKSTEP = {"lockstep.enabled": True}


def plans(count: int, seed: int) -> Iterator[tuple[str, int, RunPlan]]:
    """Yield the plans: what each is, its number among its kind, and the plan."""
    for i, (name, scenario) in enumerate(SCENARIOS.items()):
        yield name, i, scenario.plan(lockstep=True)
    for i, (figure, (controller, file)) in enumerate(product(_FIGURES, _CONTROLLERS)):
        yield f"{figure} {file}", i, make_plan(figure, controller, [file], everywhere=_LOCKSTEP)
    for i in range(count):
        yield f"random plan {i}", i, random_plan(i)
        yield f"random links {i}", i, random_links(i, seed)


def tried(plan: RunPlan, paths: Sequence[str], folder: Path, seed: int) -> Iterator[str]:
    """Yield how the runs of a plan differ."""
    try:
        run = reference(plan, folder)
    except PlanError:  # which compiled code must refuse with the same words
        yield from filter(None, [first_difference(plan, Batch())])
        return
    for path in paths:
        if not run.recording.complete and path not in ("compiled", "batch", "c"):
            continue  # it diverges, wherever it runs
        try:
            found = differences(path, plan, run, folder, seed) or []
        except PlanError:  # of changes by hand there is no run in one call
            assert plan.changes or plan.references
            continue
        yield from (f"{path}: {line}" for line in found)


@click.command()
@click.argument("count", type=int, default=100)
@click.option("--path", "chosen", multiple=True, type=click.Choice(list(PATHS)), help="Only these.")
@click.option("--graphs", default=30, show_default=True, help="Of each kind by the real nodes.")
@click.option("--seed", default=1, show_default=True, help="Of links, branches and start orders.")
@click.option("--busy", is_flag=True, help="Keep every core busy.")
def main(count: int, chosen: Sequence[str], graphs: int, seed: int, busy: bool) -> None:
    """Compare the runs and print what differs; the exit code is 1 if anything does."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    load = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range((os.cpu_count() or 1) * busy)
    ]
    made = wrong = 0
    try:
        for name, i, plan in plans(count, seed):
            graph = i < graphs and plan.simulator.lockstep and not (plan.changes or plan.references)
            able = PATHS if graph else IN_ONE_PROCESS
            paths = [path for path in chosen or able if path in able]
            with TemporaryDirectory(prefix="trunk-bits-") as folder:
                lines = list(tried(plan, paths, Path(folder), seed + i))
            made += 1
            wrong += bool(lines)
            if lines:
                print(f"{name}: {'; '.join(lines)[:300]}", flush=True)
    finally:
        for process in load:
            process.kill()
    print(f"{made} plans, each by up to {len(chosen or PATHS)} paths: {wrong} differ")
    raise SystemExit(min(wrong, 1))


if __name__ == "__main__":
    main()
