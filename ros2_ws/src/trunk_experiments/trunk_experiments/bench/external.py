"""A node of somebody else's beside ours in the same run: lock-step rate, late steps, round trip."""

from __future__ import annotations

import shlex
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import click
import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.node import middleware

from ..errors import BenchRunError
from ..plans.plan import RunPlan, make_plan
from ..recorded.run import RecordedRun
from ..replay.doubts import late_steps
from ..runs.files import RunFiles
from ..runs.graph import run_graph
from .lockstep import FINISHED
from .realtime import RealtimeRow

OURS, THEIRS = "pid", "external"
_LOCKSTEP = "lock-step, steps/s"
_END_S = 5.0  # that a node has to end


def bench_external(command: str, rounds: int, rate: float, seconds: float) -> list[RealtimeRow]:
    """Measure the ``pid`` node and the node that a command starts, in turn; medians, and theirs to ours.

    Raises BenchRunError if the command cannot be started, and RunError for a run that fails.
    """
    middleware.prepare()
    samples: dict[tuple[str, str], list[float]] = {}
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        for number in range(rounds):
            for lockstep in (True, False):
                for side in (OURS, THEIRS):
                    plan = _plan(side, lockstep, rate, seconds)
                    files = RunFiles(Path(folder) / f"{number}_{lockstep}_{side}")
                    files.folder.mkdir()
                    with _beside(command if side == THEIRS else ""):
                        recording = run_graph(plan, files, lambda t: None, note=_note)
                    run = RecordedRun(recording)
                    measured = _lockstep(files) if lockstep else _real_time(run)
                    for measure, value in measured.items():
                        samples.setdefault((side, measure), []).append(value)
    middle = {key: median(values) for key, values in samples.items()}
    rows = []
    for (side, measure), value in middle.items():
        ours = middle[OURS, measure]
        unit = "ms" if measure.startswith("round trip") else ""
        rows.append(
            RealtimeRow(side, measure, value, unit, value / ours if ours else None, "", None)
        )
    return sorted(rows, key=lambda row: row.measure)


def _plan(side: str, lockstep: bool, rate: float, seconds: float) -> RunPlan:
    everywhere: dict[str, object] = {
        "lockstep.enabled": lockstep,
        "duration": seconds,
        "update_rate": rate,
    }
    external = "bench" if side == THEIRS else None
    return make_plan("fig8", "pid", everywhere=everywhere, external=external)


def _note(line: str) -> None:
    click.echo(line, err=True)


@contextmanager
def _beside(command: str) -> Iterator[None]:
    """Run a command beside what follows; none if it is empty."""
    if not command:
        yield
        return
    try:
        process = subprocess.Popen(shlex.split(command), stdin=subprocess.DEVNULL)
    except OSError as error:
        raise BenchRunError(f"benchmark: {command}: {error.strerror}") from None
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _lockstep(files: RunFiles) -> dict[str, float]:
    """Return steps per second, as the simulator says."""
    line = FINISHED.search(files.log("simulator").read_text(errors="replace"))
    if line is None:
        raise BenchRunError(f"benchmark: {files.log('simulator')}: the run did not finish")
    return {_LOCKSTEP: int(line[1]) / float(line[2])}


def _real_time(run: RecordedRun) -> dict[str, float]:
    """Return late steps, unanswered states, and the time from a state to its answer as recorded, ms."""
    late = late_steps(run)
    states, commands = run.table(topics.JOINT_STATES), run.table(topics.EFFORT_COMMAND)
    rows = commands.rows_of(states.stamp_ns)
    there = rows >= 0
    trip = (commands.log_time_ns[rows[there]] - states.log_time_ns[there]) / 1e6
    return {
        "late steps": float(late.late if late else 0),
        "unanswered states": float(np.count_nonzero(~there)),
        "round trip, median": float(np.median(trip)) if len(trip) else float("nan"),
        "round trip, 99 %": float(np.quantile(trip, 0.99)) if len(trip) else float("nan"),
    }
