"""The loop of real nodes beside bare pairs of rclpy processes, itself with open pages, and your node.

The bare pair (`bare_pair.py`) is plain rclpy: one process publishes a JointState, the other answers at once
what it receives; rclpy's own executor, reliable topics. In real time all are measured in the same way by the
same observer, from DDS's source timestamps:

- period: between two consecutive states;
- missed steps: periods of the set rate that passed without a state;
- latency: from writing a state to writing the answer with its stamp: the transfer to the
  other process, its wake-up, and its work before it answers;
- processor time of each process, as the operating system counts it, per second.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from trunk_core import topics
from trunk_evidence.recorded_run import RecordedRun, late_steps
from trunk_runs.graph import run_graph
from trunk_runs.nodes import NODES
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.processes import NodeProcess, find_executable, stop
from trunk_runs.run_files import RunFiles
from trunk_views.live.process import LOOPBACK, GatewayProcess

from .harness import BenchError, Row

if TYPE_CHECKING:
    from .observer import Observer

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
_START_S, _WARM_UP_S = 30.0, 1.0
_LATENCY_GOAL, _PAGES_GOAL = 1.3, 1.05
_DEADLINE_S = 300.0  # of a lock-step run
_END_S = 5.0  # that a node has to end
_BARE = "bare pair"
_MICRO = 1e6
FINISHED = re.compile(r"finished: (\d+) steps in ([\d.]+) s of wall time")
# Fields of /proc/PID/stat, counted after the name in brackets: user and system time of all threads.
_UTIME, _STIME = 11, 12


# ── processes ────────────────────────────────────────────────────────────────────────────────────────────
@dataclass(frozen=True)
class Way:
    """Processes in start order, each by its name and its command; they share a plan's parameters."""

    processes: tuple[tuple[str, tuple[str, ...]], ...]
    plan: RunPlan | None = None

    @contextmanager
    def started(self, folder: Path) -> Iterator[list[NodeProcess]]:
        """Make the folder, start all with the plan's parameters, and stop them at the end."""
        folder.mkdir()
        parameters = folder / "params.yaml"
        parameters.write_text("/**:\n  ros__parameters: {}\n")
        if self.plan is not None:
            recorder = replace(self.plan.recorder, output=str(folder / "run.mcap"))
            replace(self.plan, recorder=recorder).write_parameters(parameters)
        running: list[NodeProcess] = []
        try:
            for name, command in self.processes:
                log = folder / f"{len(running)}.log"
                running.append(NodeProcess.start(name, command, parameters, log))
            yield running
        finally:
            for process in reversed(running):
                stop([process], [])


def bare(*words: str) -> tuple[str, tuple[str, ...]]:
    """Return one side of a bare pair."""
    return "bare_pair", (sys.executable, str(Path(__file__).with_name("bare_pair.py")), *words)


def own(name: str, *words: str) -> tuple[str, tuple[str, ...]]:
    """Return one of the project's executables."""
    package = NODES[name].package if name in NODES else "trunk_experiments"
    return name, (str(find_executable(package, name)), *words)


def resident_bytes(pid: int) -> int:
    """Return the process's resident memory (RSS), shared pages included. Raises OSError."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        key, _, value = line.partition(":")
        if key == "Rss":
            return int(value.split()[0]) * 1024
    raise OSError(f"/proc/{pid}/smaps_rollup: no line Rss")


def processor_seconds(pid: int) -> float:
    """Return the processor time that all threads of the process have used. Raises OSError."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[_UTIME]) + int(fields[_STIME])) / os.sysconf("SC_CLK_TCK")


# ── lock-step ────────────────────────────────────────────────────────────────────────────────────────────
def lockstep(rounds: int = 5, steps: int = 5000) -> list[Row]:
    """Compare lock-step loops with a bare pair of rclpy processes that echo the same messages."""
    quiet, full = _plan(False, False, steps), _plan(True, True, steps)
    names = ("recorder", "fuzzy_pid", "disturbance", "simulator")
    loops = {
        _BARE: Way((bare("echo"), bare("ping", str(steps)))),
        "processes": Way((own("fuzzy_pid"), own("simulator")), quiet),
        "processes, recorder, disturbance": Way(tuple(map(own, names)), full),
        "composed": Way((own("composed", "fuzzy_pid", "simulator"),), quiet),
        "composed, recorder, disturbance": Way((own("composed", *names),), full),
    }
    rates: dict[str, list[float]] = {name: [] for name in loops}
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        for number in range(rounds):
            for name, loop in loops.items():
                with loop.started(Path(folder) / f"{number}_{name}") as running:
                    rates[name].append(_rate(running[-1]))
    compared: dict[str, tuple[str, float | None]] = {
        "processes": (_BARE, 0.85),
        "processes, recorder, disturbance": (_BARE, 0.4),
        "composed": ("processes", 3.0),
        "composed, recorder, disturbance": ("processes, recorder, disturbance", None),
    }
    return [
        Row.of(f"{name} (ours) / {against}", rates[name], rates[against], "steps/s", at_least=goal)
        for name, (against, goal) in compared.items()
    ]


def _plan(disturbed: bool, recorded: bool, steps: int) -> RunPlan:
    plan = make_plan(
        "fig8" if disturbed else "fig6",
        "fuzzy_pid",
        settings=("simulator.substeps=1",),
        everywhere={"lockstep.enabled": True, "duration": steps / 1000.0},
    )
    return plan if recorded else plan.unrecorded()


def _rate(process: NodeProcess) -> float:
    """Return the steps per second that a process says when it ends."""
    deadline = time.monotonic() + _DEADLINE_S
    while process.exit_code is None:
        if time.monotonic() > deadline:
            process.signal(signal.SIGKILL)
        time.sleep(0.02)
    match = FINISHED.search(process.log.read_text(errors="replace"))
    if match is None:
        raise BenchError(f"benchmark: {process.describe_end()}")
    return int(match[1]) / float(match[2])


# ── real time ────────────────────────────────────────────────────────────────────────────────────────────
def realtime(rounds: int = 3, rate: float = 1000.0, seconds: float = 10.0) -> list[Row]:
    """Compare jitter and latency in real time with a bare rclpy timer and echo."""
    loops = {
        _BARE: Way((bare("timer", repr(rate)), bare("answer"))),
        "pid": graph_of("pid", rate),
        "fuzzy_pid": graph_of("fuzzy_pid", rate),
        "fuzzy_pid, recorder": graph_of("fuzzy_pid", rate, recorded=True),
    }
    measures: dict[str, list[dict[str, float]]] = {name: [] for name in loops}
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        for number in range(rounds):
            for name, loop in loops.items():
                place = Path(folder) / f"{number}_{name}"
                measures[name].append(_measure(loop, rate, seconds, place))
    return [
        _row(f"{loop}: {measure}", measure, some, measures[_BARE], _LATENCY_GOAL)
        for loop, some in measures.items()
        if loop != _BARE
        for measure in MEASURES
    ]


def _row(
    name: str,
    measure: str,
    ours: Sequence[Mapping[str, float]],
    theirs: Sequence[Mapping[str, float]],
    goal: float,
) -> Row:
    """Compare a measure of two loops, the median of the latency with a goal."""
    a, b = ([values[measure] for values in some] for some in (ours, theirs))
    at_most = goal if measure == LATENCY else None
    return replace(Row.of(name, a, b, "", at_most=at_most), unit=MEASURES[measure])


def graph_of(controller: str, rate: float, recorded: bool = False) -> Way:
    """Return how a simulator and a controller are started, with a recorder if asked."""
    plan = make_plan("fig6", controller, everywhere={"update_rate": rate, "duration": 0.0})
    names = ("simulator", controller, *(["recorder"] if recorded else []))
    return Way(tuple(map(own, names)), plan if recorded else plan.unrecorded())


def _measure(loop: Way, rate: float, seconds: float, folder: Path) -> dict[str, float]:
    """Run once and return the measures; ``loop`` names the publisher of states first, then the answerer.

    Raises BenchError if a process ends early.
    """
    from .observer import Observer

    with (
        loop.started(folder) as running,
        Observer((topics.JOINT_STATES, topics.EFFORT_COMMAND)) as observer,
    ):
        begin(running, observer, seconds)
        return measured(running, observer, rate, seconds)


def _check(running: Sequence[NodeProcess]) -> None:
    for process in running:
        if process.exit_code is not None:
            raise BenchError(f"benchmark: {process.describe_end()}")


def begin(running: Sequence[NodeProcess], observer: Observer, seconds: float) -> None:
    """Wait until a loop runs, and let it warm up. Raises BenchError if a process ends or says nothing."""

    def check() -> None:
        _check(running)

    deadline = time.monotonic() + _START_S
    while not all(observer.written_ns.values()):  # of both: each is discovered separately
        observer.watch(0.2, check)
        if time.monotonic() > deadline:
            raise BenchError(f"benchmark: {running[1].name} did not answer within {_START_S:g} s")
    observer.watch(min(_WARM_UP_S, seconds), check)


def measured(
    running: Sequence[NodeProcess], observer: Observer, rate: float, seconds: float
) -> dict[str, float]:
    """Return the measures of a loop that runs. Raises BenchError if a process ends."""
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
    names = [name for name in MEASURES if name.startswith("CPU")]
    return measures | {name: 100.0 * share for name, share in zip(names, shares, strict=False)}


def timing(
    states_ns: Mapping[int, int], answers_ns: Mapping[int, int], rate: float
) -> dict[str, float]:
    """Return the measures of two streams: stamp -> instant of writing, ns. ``rate`` in Hz.

    Answers to earlier states are left out, and so are the last states, which nobody can have answered yet.
    Raises BenchError if there are too few.
    """
    written = np.sort(np.fromiter(states_ns.values(), np.int64))
    if len(written) < 3:
        raise BenchError(f"benchmark: only {len(written)} states arrived; measure for longer")
    period = np.diff(written) / 1e9
    deviation = np.abs(period - 1.0 / rate)
    latency = np.array([t - states_ns[s] for s, t in answers_ns.items() if s in states_ns]) / 1e9
    if not len(latency):
        raise BenchError("benchmark: no state was answered")
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


# ── pages ────────────────────────────────────────────────────────────────────────────────────────────────
def live(rounds: int = 5, rate: float = 1000.0, seconds: float = 10.0, pages: int = 4) -> list[Row]:
    """Compare latency and missed steps of a loop while pages show it with the same loop without pages."""
    from .observer import Observer

    alone, served = [], []
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        loop = graph_of("fuzzy_pid", rate, recorded=True)
        with (
            loop.started(Path(folder) / "run") as running,
            Observer((topics.JOINT_STATES, topics.EFFORT_COMMAND)) as observer,
        ):
            begin(running, observer, seconds)
            for _ in range(rounds):
                alone.append(measured(running, observer, rate, seconds))
                with _pages(Path(folder) / "gateway.log", pages):
                    observer.watch(1.0, lambda: None)
                    served.append(measured(running, observer, rate, seconds))
                observer.watch(1.0, lambda: None)
    rows = [
        _row(f"{name}, with pages (ours) / alone", name, served, alone, _PAGES_GOAL)
        for name in MEASURES
        if not name.startswith("CPU")
    ]
    return [
        replace(row, goal="not more", met=row.ours <= row.theirs) if "missed" in row.name else row
        for row in rows
    ]


@contextmanager
def _pages(log: Path, count: int) -> Iterator[None]:
    """Serve the graph to this many pages, which read everything."""
    gateway = GatewayProcess(log, LOOPBACK, 0, {"namespace": ""})
    try:
        with readers(gateway, log, count):
            yield
    finally:
        gateway.close()


@contextmanager
def readers(gateway: GatewayProcess, log: Path, count: int) -> Iterator[None]:
    """Let this many pages read everything. Raises BenchError if they are not served to the end."""
    process = subprocess.Popen(
        [
            *(sys.executable, str(Path(__file__).with_name("page_readers.py"))),
            *(gateway.address(gateway.tokens.watch), str(count)),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with process:
        assert process.stdout is not None
        if process.stdout.readline() != "ready\n":
            raise BenchError(f"benchmark: the gateway did not serve {count} pages: see {log}")
        yield
        if process.poll() is not None:
            raise BenchError(f"benchmark: the gateway stopped serving pages: see {log}")
        assert process.stdin is not None
        process.stdin.close()


# ── your node ────────────────────────────────────────────────────────────────────────────────────────────
def external(node: str, rounds: int = 3, rate: float = 1000.0, seconds: float = 4.0) -> list[Row]:
    """Compare a controller's node of your own, started by the command NODE, with our pid: theirs to ours."""
    samples: dict[str, tuple[list[float], list[float]]] = {}
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        for number in range(rounds):
            for in_lockstep in (True, False):
                for side, command in enumerate(("", node)):
                    everywhere: dict[str, object] = {
                        "lockstep.enabled": in_lockstep,
                        "duration": seconds,
                        "update_rate": rate,
                    }
                    external = "bench" if command else None
                    plan = make_plan("fig8", "pid", everywhere=everywhere, external=external)
                    files = RunFiles(Path(folder) / f"{number}_{in_lockstep}_{side}")
                    files.folder.mkdir()
                    with _beside(command):
                        found = (_lockstep if in_lockstep else _real_time)(plan, files)
                    for measure, value in found.items():
                        samples.setdefault(measure, ([], []))[side].append(value)
    return [
        replace(Row.of(name, ours, theirs, "", inverse=True), unit=MEASURES.get(name, ""))
        for name, (ours, theirs) in samples.items()
    ]


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
        raise BenchError(f"benchmark: {command}: {error.strerror}") from None
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
        raise BenchError(f"benchmark: {files.log('simulator')}: the run did not finish")
    return {"lock-step, steps/s": int(line[1]) / float(line[2])}


def _real_time(plan: RunPlan, files: RunFiles) -> dict[str, float]:
    """Run, and return late steps, unanswered states, and the time from a state's writing to its answer's."""
    from .observer import Observer

    with Observer((topics.JOINT_STATES, topics.EFFORT_COMMAND)) as observer:
        recording = run_graph(plan, files, lambda t: observer.take(), note=_note)
        observer.take()
    late = late_steps(RecordedRun(recording))
    states_ns = observer.written_ns[topics.JOINT_STATES]
    answers_ns = observer.written_ns[topics.EFFORT_COMMAND]
    timed = timing(states_ns, answers_ns, plan.simulator.update_rate)
    return {
        "late steps": float(late.steps if late else 0),
        "unanswered states": float(len(states_ns.keys() - answers_ns.keys())),
        **{name: value for name, value in timed.items() if name.startswith("latency")},
    }
