"""Many plans by every path, bit by bit:

    source scripts/env.sh && python -m tests.same_bits.check [COUNT] [--seed N] [--random] [--path PATH] ...

The scenarios of tests/same_bits, the figures with their controllers, COUNT random plans over every declared
parameter, also of the laws of `own_laws`, and as many with random links; the first ones of each kind by the
real nodes, too. ``COUNT --random --seed N`` repeats the random ones from the N-th on.
"""

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain, product
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from ros2_ws.src.trunk_experiments.test.test_own_packages import install
from ros2_ws.src.trunk_runs.test.random_plans import ANY_LAW, random_plan

from trunk_core.errors import PlanError
from trunk_experiments.conformance.kit import first_difference
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.plan import RunPlan, make_plan

from ..tampering.graph_runs import for_graph
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
_HERE = Path(__file__).parent
OWN = ("counting", "plain")


def with_own_laws(folder: Path) -> dict[str, str]:
    """Install the laws of `own_laws` into a folder and return the environment of a process that has them."""
    entries = (f"{name} = own_laws:{name.upper()}" for name in OWN)
    install(folder, "own_laws", *entries, module=(_HERE / "own_laws.py").read_text("utf-8"))
    path = os.pathsep.join([str(folder), str(_HERE.parents[1]), os.environ["PYTHONPATH"]])
    return {**os.environ, "PYTHONPATH": path}


def fixed_plans() -> Iterator[tuple[str, int, RunPlan]]:
    """Yield scenarios and figures: what each is, its number among its kind, and the plan."""
    for i, (name, scenario) in enumerate(SCENARIOS.items()):
        yield name, i, scenario.plan(lockstep=True)
    for i, (figure, (controller, file)) in enumerate(product(_FIGURES, _CONTROLLERS)):
        yield f"{figure} {file}", i, make_plan(figure, controller, [file], everywhere=_LOCKSTEP)


def random_plans(count: int, seed: int) -> Iterator[tuple[str, int, RunPlan]]:
    """Yield the random ones from the ``seed``-th on, likewise."""
    for i in range(count):
        plan = random_plan(ANY_LAW + seed + i)
        # Its nodes' lock-step, turns and starts are drawn one by one: a graph needs them to agree.
        plan = for_graph(plan, lockstep=True) if plan.simulator.lockstep else plan
        yield f"random plan {seed + i}", i, plan
        yield f"random links {seed + i}", i, random_links(seed + i, 1)


def tried(
    plan: RunPlan, paths: Sequence[str], folder: Path, seed: int, taken: Counter[str]
) -> Iterator[str]:
    """Yield how the runs of a plan differ; count the paths that make one, or that it is refused."""
    try:
        run = reference(plan, folder)
    except PlanError:  # which compiled code must refuse with the same words
        taken["refused"] += 1
        yield from filter(None, [first_difference(plan)])
        return
    for path in paths:
        if not run.recording.complete and path not in ("compiled", "batch", "kernel", "c"):
            continue  # it diverges, wherever it runs
        try:
            found = differences(path, plan, run, folder, seed)
        except PlanError:  # of changes by hand there is no run in one call
            assert plan.changes or plan.references
            continue
        taken[path] += found is not None
        yield from (f"{path}: {line}" for line in found or ())


@click.command()
@click.argument("count", type=int, default=100)
@click.option("--path", "chosen", multiple=True, type=click.Choice(list(PATHS)), help="Only these.")
@click.option("--graphs", default=30, show_default=True, help="Of each kind by the real nodes.")
@click.option("--seed", default=0, show_default=True, help="The first random plan.")
@click.option("--random", "alone", is_flag=True, help="Random plans alone.")
@click.option("--busy", is_flag=True, help="Keep every core busy.")
def main(
    count: int, chosen: Sequence[str], graphs: int, seed: int, alone: bool, busy: bool
) -> None:
    """Compare the runs and print what differs; the exit code is 1 if anything does."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    load = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range((os.cpu_count() or 1) * busy)
    ]
    made = wrong = 0
    taken = Counter[str]()
    try:
        for name, i, plan in chain(() if alone else fixed_plans(), random_plans(count, seed)):
            graph = i < graphs and plan.simulator.lockstep and not (plan.changes or plan.references)
            graph &= plan.controllers.keys().isdisjoint(OWN)  # they have no executables
            able = PATHS if graph else IN_ONE_PROCESS
            paths = [path for path in chosen or able if path in able]
            with TemporaryDirectory(prefix="trunk-bits-") as folder:
                lines = list(tried(plan, paths, Path(folder), seed + i, taken))
            made += 1
            wrong += bool(lines)
            if lines:
                print(f"{name}: {'; '.join(lines)[:300]}", flush=True)
    finally:
        for process in load:
            process.kill()
    by = ", ".join(f"{path} {count}" for path, count in taken.items())
    print(f"{made} plans: {wrong} differ ({by})")
    raise SystemExit(min(wrong, 1))


if __name__ == "__main__":
    if not {*OWN} <= {*CONTROLLERS}:
        with TemporaryDirectory(prefix="trunk-laws-") as site:
            command = [sys.executable, "-m", "tests.same_bits.check", *sys.argv[1:]]
            done = subprocess.run(command, env=with_own_laws(Path(site)), check=False)
        raise SystemExit(done.returncode)
    main()
