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

from trunk_msgs_util import topics

from ..errors import BenchRunError
from ..plans.plan import RunPlan, make_plan
from ..recorded.run import RecordedRun
from ..replay.late import late_steps
from ..runs.files import RunFiles
from ..runs.graph import run_graph
from .lockstep import FINISHED
from .realtime import MEASURES, RealtimeRow, timing

OURS, THEIRS = "pid", "external"
_LOCKSTEP = "lock-step, steps/s"
_END_S = 5.0  # that a node has to end


def bench_external(command: str, rounds: int, rate: float, seconds: float) -> list[RealtimeRow]:
    """Measure the ``pid`` node and the node that a command starts, in turn; medians, and theirs to ours.

    Raises BenchRunError if the command cannot be started, and RunError for a run that fails.
    """
    samples: dict[tuple[str, str], list[float]] = {}
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        for number in range(rounds):
            for lockstep in (True, False):
                for side in (OURS, THEIRS):
                    plan = _plan(side, lockstep, rate, seconds)
                    files = RunFiles(Path(folder) / f"{number}_{lockstep}_{side}")
                    files.folder.mkdir()
                    with _beside(command if side == THEIRS else ""):
                        measured = (_lockstep if lockstep else _real_time)(plan, files)
                    for measure, value in measured.items():
                        samples.setdefault((side, measure), []).append(value)
    middle = {key: median(values) for key, values in samples.items()}
    rows = []
    for (side, measure), value in middle.items():
        ours = middle[OURS, measure]
        unit = MEASURES.get(measure, "")
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


def _lockstep(plan: RunPlan, files: RunFiles) -> dict[str, float]:
    """Run, and return steps per second, as the simulator says."""
    run_graph(plan, files, lambda t: None, note=_note)
    line = FINISHED.search(files.log("simulator").read_text(errors="replace"))
    if line is None:
        raise BenchRunError(f"benchmark: {files.log('simulator')}: the run did not finish")
    return {_LOCKSTEP: int(line[1]) / float(line[2])}


def _real_time(plan: RunPlan, files: RunFiles) -> dict[str, float]:
    """Run, and return late steps, unanswered states, and the time from a state's writing to its answer's."""
    from ..live.observer_node import Observer

    with Observer((topics.JOINT_STATES, topics.EFFORT_COMMAND)) as observer:
        recording = run_graph(plan, files, lambda t: observer.take(), note=_note)
        observer.take()
    late = late_steps(RecordedRun(recording))
    states_ns = observer.written_ns[topics.JOINT_STATES]
    answers_ns = observer.written_ns[topics.EFFORT_COMMAND]
    timed = timing(states_ns, answers_ns, plan.simulator.update_rate)
    return {
        "late steps": float(late.late if late else 0),
        "unanswered states": float(len(states_ns.keys() - answers_ns.keys())),
        **{name: value for name, value in timed.items() if name.startswith("latency")},
    }
