"""Rates of the lock-step loop against a bare pair of rclpy processes, all measured in one run."""

from __future__ import annotations

import re
import signal
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from ..errors import BenchRunError
from ..plans.nodes import NODES
from ..plans.plan import RunPlan, make_plan
from ..runs.processes import NodeProcess
from .processes import Way

FINISHED = re.compile(r"finished: (\d+) steps in ([\d.]+) s of wall time")
_DEADLINE_S = 300.0


@dataclass(frozen=True)
class LockstepRow:
    """One way of running the loop: steps per second, and its ratio to another way's."""

    name: str
    rate_hz: float
    ratio: float
    against: str
    goal: str
    met: bool | None


def _rate(loop: Way, folder: Path) -> float:
    """Run once and return steps per second; the last process says how long it took."""
    with loop.started(folder) as running:
        return _await(running[-1])


def _await(process: NodeProcess) -> float:
    deadline = time.monotonic() + _DEADLINE_S
    while process.exit_code is None:
        if time.monotonic() > deadline:
            process.signal(signal.SIGKILL)
        time.sleep(0.02)
    match = FINISHED.search(process.log.read_text(errors="replace"))
    if match is None:
        raise BenchRunError(f"benchmark: {process.describe_end()}")
    return int(match[1]) / float(match[2])


def _plan(disturbed: bool, recorded: bool, steps: int) -> RunPlan:
    plan = make_plan(
        "fig8" if disturbed else "fig6",
        "fuzzy_pid",
        settings=("simulator.substeps=1",),
        everywhere={"lockstep.enabled": True, "duration": steps / 1000.0},
    )
    return plan if recorded else plan.unrecorded()


def _graph(plan: RunPlan, names: tuple[str, ...]) -> Way:
    return Way(tuple((name, NODES[name].package, ()) for name in names), plan)


def bench_lockstep(rounds: int = 5, steps: int = 5000) -> list[LockstepRow]:
    """Measure each loop ``rounds`` times in turn; the medians make the ratios.

    Raises BenchRunError if a process does not finish.
    """
    pair = "trunk_experiments"
    quiet, full = _plan(False, False, steps), _plan(True, True, steps)
    loops = {
        "bare pair": Way(
            (("bare_pair", pair, ("echo",)), ("bare_pair", pair, ("ping", str(steps))))
        ),
        "processes": _graph(quiet, ("fuzzy_pid", "simulator")),
        "processes, recorder, disturbance": _graph(
            full, ("recorder", "fuzzy_pid", "disturbance", "simulator")
        ),
        "composed": Way((("composed", pair, ("fuzzy_pid", "simulator")),), quiet),
        "composed, recorder, disturbance": Way(
            (("composed", pair, ("recorder", "fuzzy_pid", "disturbance", "simulator")),), full
        ),
    }
    rates: dict[str, list[float]] = {name: [] for name in loops}
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        for round_number in range(rounds):
            for name, loop in loops.items():
                rates[name].append(
                    _rate(loop, Path(folder) / f"{round_number}_{len(rates[name])}_{name}")
                )
    middle = {name: median(values) for name, values in rates.items()}
    goals = {
        "processes": ("bare pair", 0.85),
        "processes, recorder, disturbance": ("bare pair", 0.4),
        "composed": ("processes", 3.0),
        "composed, recorder, disturbance": ("processes, recorder, disturbance", None),
    }
    rows = [LockstepRow("bare pair", middle["bare pair"], 1.0, "", "", None)]
    for name, (against, goal) in goals.items():
        ratio = middle[name] / middle[against]
        rows.append(
            LockstepRow(
                name,
                middle[name],
                ratio,
                against,
                "" if goal is None else f">= {goal:g}",
                None if goal is None else ratio >= goal,
            )
        )
    return rows
