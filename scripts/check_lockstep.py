"""Figures x controllers: processes = composed = offline, bit for bit, again and again, under load.

    source scripts/env.sh && python scripts/check_lockstep.py [--repeat 3]

Nodes are started in shuffled (seeded) order while every core is kept busy. Takes some twenty minutes.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path

import click

from trunk_experiments.plans.plan import RunPlan, make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_experiments.runs.files import RunFiles
from trunk_experiments.runs.graph import run_graph
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.recording.reader import Recording

SCENARIOS = ("fig6", "fig7", "fig8", "fig9")
CONTROLLERS = (
    ("pid", "pid_ziegler_nichols"),
    ("pid", "pid_as_printed"),
    ("fuzzy_pid", "fuzzy_as_printed"),
    ("lqr", "profile_practical"),
    ("computed_torque", "profile_practical"),
)


def check(plan: RunPlan, folder: Path, repeat: int, shuffle: random.Random) -> list[str]:
    """Return what went wrong with one plan."""
    offline = folder / "offline.mcap"
    record_offline(plan, offline)
    problems = []
    for number in range(repeat):
        for composed in (False, True):
            order = list(plan.configs)
            shuffle.shuffle(order)
            files = RunFiles(folder / f"{'composed' if composed else 'processes'}_{number}")
            run_graph(plan, files, lambda _: None, order=order, composed=composed)
            recording = Recording.open(files.recording)
            found = diff(RecordedRun.open(offline), RecordedRun(recording))
            if found.first is not None:
                problems.append(f"{files.folder.name}: {found.first.describe()}")
            verdict = verify(recording)
            if verdict.exit_code != VERIFIED:
                problems.append(f"{files.folder.name}: {verdict.word}: {verdict.reasons}")
    return problems


@click.command()
@click.option("--repeat", default=3, show_default=True, help="Graph runs of each kind.")
@click.option("--seed", default=1, show_default=True, help="Seed of the start order.")
def main(repeat: int, seed: int) -> None:
    """Check the whole matrix; exit code 1 if any run differs."""
    shuffle = random.Random(seed)
    load = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(os.cpu_count() or 1)
    ]
    failed = False
    try:
        for scenario in SCENARIOS:
            for controller, params in CONTROLLERS:
                plan = make_plan(
                    scenario, controller, [params], everywhere={"lockstep.enabled": True}
                )
                with tempfile.TemporaryDirectory(prefix="lockstep_") as folder:
                    problems = check(plan, Path(folder), repeat, shuffle)
                failed |= bool(problems)
                outcome = "; ".join(problems) or f"{2 * repeat} graph runs identical to offline"
                click.echo(f"{scenario} {params}: {outcome}")
    finally:
        for process in load:
            process.kill()
    sys.exit(failed)


if __name__ == "__main__":
    main()
