"""Jitter and latency of the loop in real time against a bare pair of rclpy processes, in one run.

The bare pair is plain rclpy: a node with a timer that publishes a JointState, and a second one that
republishes at once what it receives; rclpy's own executor, reliable topics. Both are measured
in the same way by the same observer, from DDS's source timestamps:

- period: between two consecutive states;
- missed steps: periods of the set rate that passed without a state;
- latency: from writing a state to writing the answer with its stamp: the transfer to the
  other process, its wake-up, and its work before it answers;
- processor time of each process, as the operating system counts it, per second.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics

from ..errors import BenchError, BenchRunError
from ..plans.nodes import NODES
from ..plans.plan import make_plan
from ..runs.processes import NodeProcess
from .processes import Way
from .usage import processor_seconds

if TYPE_CHECKING:
    from ..live.observer_node import Observer

_START_S = 30.0
_WARM_UP_S = 1.0
_BARE = "bare pair"
_GOAL = 1.3
_MICRO = 1e6
_SIDES = ("source", "answerer")
LATENCY = "latency, median"
MEASURES: dict[str, str] = {  # and their units
    "period, std dev": "us",
    "period, 99.9 %": "us",
    "missed steps": "",
    "unanswered": "",
    LATENCY: "us",
    "latency, 99 %": "us",
    "latency, 99.9 %": "us",
    "CPU, source": "%",
    "CPU, answerer": "%",
}


@dataclass(frozen=True)
class RealtimeRow:
    """A measure of a loop: the median over the rounds, and that of its ratio to the bare pair's."""

    loop: str
    measure: str
    value: float
    unit: str
    ratio: float | None
    goal: str
    met: bool | None


def _measure(loop: Way, rate: float, seconds: float, folder: Path) -> dict[str, float]:
    """Run once and return the measures; ``loop`` names the publisher of states first, then the answerer.

    Raises BenchRunError if a process ends early.
    """
    from ..live.observer_node import Observer

    with (
        loop.started(folder) as running,
        Observer((topics.JOINT_STATES, topics.EFFORT_COMMAND)) as observer,
    ):
        begin(running, observer, seconds)
        return measured(running, observer, rate, seconds)


def _check(running: Sequence[NodeProcess]) -> None:
    for process in running:
        if process.exit_code is not None:
            raise BenchRunError(f"benchmark: {process.describe_end()}")


def begin(running: Sequence[NodeProcess], observer: Observer, seconds: float) -> None:
    """Wait until a loop runs, and let it warm up. Raises BenchRunError if a process ends or says nothing."""

    def check() -> None:
        _check(running)

    deadline = time.monotonic() + _START_S
    while not all(observer.written_ns.values()):  # of both: each is discovered separately
        observer.watch(0.2, check)
        if time.monotonic() > deadline:
            raise BenchRunError(
                f"benchmark: {running[1].name} did not answer within {_START_S:g} s"
            )
    observer.watch(min(_WARM_UP_S, seconds), check)


def measured(
    running: Sequence[NodeProcess], observer: Observer, rate: float, seconds: float
) -> dict[str, float]:
    """Return the measures of a loop that runs. Raises BenchRunError if a process ends."""
    used = [processor_seconds(process.process.pid) for process in running]
    began = time.monotonic()
    observer.watch(seconds, lambda: _check(running))
    took = time.monotonic() - began
    shares = [
        (processor_seconds(process.process.pid) - before) / took
        for process, before in zip(running, used, strict=True)
    ]
    written_ns = observer.written_ns
    measures = timing(written_ns[topics.JOINT_STATES], written_ns[topics.EFFORT_COMMAND], rate)
    names = list(MEASURES)[-len(_SIDES) :]
    return measures | {name: 100.0 * share for name, share in zip(names, shares, strict=False)}


def timing(
    states_ns: Mapping[int, int], answers_ns: Mapping[int, int], rate: float
) -> dict[str, float]:
    """Return the measures of two streams: stamp -> instant of writing, ns. ``rate`` in Hz.

    Answers to earlier states are left out, and so are the last states, which nobody can have answered yet.
    Raises BenchRunError if there are too few.
    """
    written = np.sort(np.fromiter(states_ns.values(), np.int64))
    if len(written) < 3:
        raise BenchRunError(f"benchmark: only {len(written)} states arrived; measure for longer")
    period = np.diff(written) / 1e9
    deviation = np.abs(period - 1.0 / rate)
    latency = np.array([t - states_ns[s] for s, t in answers_ns.items() if s in states_ns]) / 1e9
    if not len(latency):
        raise BenchRunError("benchmark: no state was answered")
    answered = max(s for s in answers_ns if s in states_ns)
    return {
        "period, std dev": float(period.std()) * _MICRO,
        "period, 99.9 %": float(np.quantile(deviation, 0.999)) * _MICRO,
        "missed steps": float(np.maximum(np.rint(period * rate) - 1.0, 0.0).sum()),
        "unanswered": float(sum(s <= answered and s not in answers_ns for s in states_ns)),
        LATENCY: float(np.median(latency)) * _MICRO,
        "latency, 99 %": float(np.quantile(latency, 0.99)) * _MICRO,
        "latency, 99.9 %": float(np.quantile(latency, 0.999)) * _MICRO,
    }


def graph_of(controller: str, rate: float, recorded: bool = False) -> Way:
    """Return how a simulator and a controller are started, with a recorder if asked."""
    plan = make_plan("fig6", controller, everywhere={"update_rate": rate, "duration": 0.0})
    names = ("simulator", controller, *(["recorder"] if recorded else []))
    return Way(
        tuple((name, NODES[name].package, ()) for name in names),
        plan if recorded else plan.unrecorded(),
    )


def bench_realtime(
    rate: float = 1000.0, seconds: float = 10.0, rounds: int = 3
) -> list[RealtimeRow]:
    """Measure each loop at ``rate`` Hz for ``seconds``, ``rounds`` times in turn.

    Raises BenchError for a number that is not allowed, BenchRunError if a process fails.
    """
    if rounds < 1:
        raise BenchError(f"rounds must be 1 or greater, not {rounds!r}")
    if not 0.0 < seconds <= 3600.0:
        raise BenchError(f"seconds must be greater than 0 and at most 3600, not {seconds!r}")
    pair = "trunk_experiments"
    loops = {
        _BARE: Way((("bare_pair", pair, ("timer", repr(rate))), ("bare_pair", pair, ("answer",)))),
        "pid": graph_of("pid", rate),
        "fuzzy_pid": graph_of("fuzzy_pid", rate),
        "fuzzy_pid, recorder": graph_of("fuzzy_pid", rate, recorded=True),
    }
    measures: dict[str, list[dict[str, float]]] = {name: [] for name in loops}
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        for number in range(rounds):
            for name, loop in loops.items():
                measures[name].append(
                    _measure(loop, rate, seconds, Path(folder) / f"{number}_{name}")
                )
    return list(_rows(measures))


def _rows(measures: Mapping[str, list[dict[str, float]]]) -> Iterable[RealtimeRow]:
    bare = measures[_BARE]
    for loop, rounds in measures.items():
        for measure, unit in MEASURES.items():
            values = [values[measure] for values in rounds]
            yardstick = [values[measure] for values in bare]
            ratio = (
                median(v / y for v, y in zip(values, yardstick, strict=True))
                if all(yardstick)
                else None
            )
            judged = measure == LATENCY and loop != _BARE and ratio is not None
            yield RealtimeRow(
                loop,
                measure,
                median(values),
                unit,
                ratio,
                f"<= {_GOAL:g}" if judged else "",
                ratio <= _GOAL if judged and ratio is not None else None,
            )
