"""Half an hour of the graph in real time: flat memory, every missed step counted, a whole file.

    source scripts/env.sh && python scripts/check_soak.py [--minutes 30] [--rate 200] [--output FOLDER]

Simulator, disturbance, Fuzzy-PID and recorder run as `scripts/run.sh` runs them. Memory is each process's
resident set (RSS of /proc/PID/smaps_rollup), read once a second from outside; after the first minute
(in a run shorter than two minutes: after its first half) it may grow by less than 2 %.

A step is missed if it was not driven by the answer to its own state. The record shows this
without any clock: the next true state carries the torque over a step, the command with
the step's stamp carries the answer. The simulator counts the same steps while it runs.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import click
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.nodes import resident_bytes

from trunk_core import topics
from trunk_core.errors import RunError, TrunkError
from trunk_core.units import seconds
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.console.tables import print_table
from trunk_msgs_util.node import middleware
from trunk_recording.reader import Recording
from trunk_runs.graph import run_graph
from trunk_runs.nodes import NODES
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.run_files import RunFiles
from trunk_sim.config import SimulatorConfig

MIB = 2**20
EVERY_S = 1.0
HUNG_S = 60.0
# Each command then differs from the one before, so that a step made with the wrong one shows.
NOISE = ("simulator.sensor.position_noise=1e-4", "simulator.sensor.velocity_noise=1e-3")
SETTLED_S = 60.0
MAX_GROWTH = 0.02
# The index is written at the end of an MCAP file: until then a recorder holds every chunk's entry. With
# two chunks a second and six topics that was 1.9 kB/s.
INDEX_BYTES_PER_S = 2000.0
UNANSWERED, LATE = "states unanswered", "commands late"
IDLE, OVERDUE = "steps without a fresh command", "deadlines missed"
# The difference of two log times includes both messages' way to the recorder.
_LOG_TOLERANCE_S = 1.0


def settled_at(duration_s: float) -> float:
    """Return the time in s after which memory must be flat: 60 s, or half of a shorter run.

    Publishers keep their last 5000 messages: at 200 Hz a node is expected to grow for 25 s.
    """
    return min(SETTLED_S, duration_s / 2.0)


@dataclass(frozen=True)
class Growth:
    """A node's settled memory in bytes, and its maximum since, without a recorder's index."""

    node: str
    settled: float
    most: float

    @property
    def ratio(self) -> float:
        """Growth as a fraction of the settled memory."""
        return self.most / self.settled - 1.0


def growth(node: str, samples: Sequence[tuple[float, int]], settled_s: float) -> Growth:
    """Return the growth of a node's memory from ``(s, bytes)`` samples in order.

    The settled memory is the median of the first tenth of the samples from ``settled_s`` on. The size
    of a recorder's index is subtracted. Raises ValueError if there are no such samples.
    """
    index = INDEX_BYTES_PER_S if node == "recorder" else 0.0
    later = [size - index * (t - settled_s) for t, size in samples if t >= settled_s]
    if not later:
        raise ValueError(f"{node}: no sample of its memory after {settled_s:g} s")
    return Growth(node, median(later[: max(len(later) // 10, 1)]), max(later))


@dataclass(frozen=True)
class Steps:
    """What a record shows about a run's steps."""

    states: int
    unanswered: int  # states without a command
    late: int  # steps made before the command answering their state arrived
    idle: int  # steps after the first torque made with none, contrary to their command
    lost_s: float  # by how much the wall clock ran ahead of the stamps


def steps_of(recording: Recording) -> Steps:
    """Return the counts of steps in the record of a real-time run; its controller answers every state.

    Raises ValueError if the run has fewer than two states.
    """
    run = RecordedRun(recording)
    config: SimulatorConfig = run.config("simulator")
    trunk = config.joints[1]
    joints = {
        name: run.joints(name).by_stamp() for name in (topics.GROUND_TRUTH, topics.EFFORT_COMMAND)
    }
    truth, commands = joints[topics.GROUND_TRUTH], joints[topics.EFFORT_COMMAND]
    if len(truth) < 2:
        raise ValueError(f"{recording.path}: {len(truth)} states are recorded, 2 are needed")
    answered = np.isin(truth.stamp_ns, commands.stamp_ns)
    own = np.full(len(truth), np.nan)
    own[answered] = commands.column("effort", trunk)[np.isin(commands.stamp_ns, truth.stamp_ns)]
    wanted = np.clip(own, -config.max_effort, config.max_effort)[:-1]
    applied = truth.column("effort", trunk)[1:]
    other = applied != wanted
    begun = np.cumsum(applied != 0.0) > 0
    return Steps(
        states=len(truth),
        unanswered=int((~answered).sum()),
        late=int((other & answered[:-1]).sum()),
        idle=int((other & begun & (applied == 0.0)).sum()),
        lost_s=seconds(int(np.ptp(truth.log_time_ns) - np.ptp(truth.stamp_ns))),
    )


def problems_of_memory(growths: Sequence[Growth], allowed: float = MAX_GROWTH) -> list[str]:
    """Return a line for each node that grew by more than the allowed fraction."""
    return [
        f"{g.node}: memory grew by {g.ratio:.1%} from {g.settled / 2**20:.1f} MiB; "
        f"less than {allowed:.0%} is allowed"
        for g in growths
        if g.ratio >= allowed
    ]


def problems_of_steps(steps: Steps, counted: Mapping[str, int], period_s: float) -> list[str]:
    """Return a line for each kind of missed step that the record shows more often than counted.

    A command that was recorded, but displaced from the simulator's full queue, counts as late in the record
    and as unanswered in the simulator: its surplus of unanswered steps is set against late ones.
    """
    problems = []
    unanswered, late = counted.get(UNANSWERED, 0), counted.get(LATE, 0)
    displaced = max(unanswered - steps.unanswered, 0)
    pairs = {
        UNANSWERED: (steps.unanswered, unanswered),
        LATE: (steps.late, late + displaced),
        IDLE: (steps.idle, counted.get(IDLE, 0)),
    }
    for name, (shown, count) in pairs.items():
        if shown > count:
            problems.append(f"{name}: the record shows {shown}, /diagnostics counted {count}")
    overdue_s = counted.get(OVERDUE, 0) * period_s
    if steps.lost_s > overdue_s + _LOG_TOLERANCE_S:
        problems.append(
            f"the run took {steps.lost_s:.1f} s longer than its stamps say; the {OVERDUE} that "
            f"/diagnostics counted explain {overdue_s:.1f} s"
        )
    return problems


def problems_of_file(recording: Recording) -> list[str]:
    """Return the problems that keep the file from being a whole, verified run."""
    verdict = verify(recording)
    if verdict.exit_code == VERIFIED:
        return []
    return [f"{recording.path}: {verdict.word}: {'; '.join(verdict.reasons)}"]


class Watch:
    """What can be seen of a run from outside: memory by node, the simulator's last diagnostics."""

    def __init__(self) -> None:
        self.memory: dict[str, list[tuple[float, int]]] = defaultdict(list)
        self.diagnosis: dict[str, str] = {}
        self._executor: SingleThreadedExecutor | None = None
        self._looked = 0.0

    def look(self, run_s: float) -> None:
        """Take a sample; called many times a second, with the run at ``run_s``."""
        if self._executor is None:  # only now: the run's processes are started before threads are
            self._listen()
        self.hear(0.0)
        if run_s > 0.0 and time.monotonic() - self._looked >= EVERY_S:
            self._looked = time.monotonic()
            for node, pid in _node_processes().items():
                with suppress(OSError):  # it has just ended
                    self.memory[node].append((run_s, resident_bytes(pid)))

    def hear(self, timeout_s: float) -> None:
        """Process diagnostics, or wait for them."""
        if self._executor is not None:
            self._executor.spin_once(timeout_sec=timeout_s)

    def _listen(self) -> None:
        middleware.prepare()
        context = rclpy.Context()
        rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
        node = Node("soak", context=context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(node)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/simulator":
                self.diagnosis = {v.key: v.value for v in status.values}

    def write_memory(self, path: Path) -> None:
        """Save all samples to a file, to show when memory grew."""
        lines = [f"{node},{t:.3f},{size}" for node, seen in self.memory.items() for t, size in seen]
        path.write_text("\n".join(["node,time_s,rss_bytes", *lines, ""]))

    def hear_the_last(self, states: int) -> dict[str, int]:
        """Return the simulator's final diagnostic counts. Raises RunError."""
        deadline = time.monotonic() + HUNG_S
        while int(self.diagnosis.get("step", -1)) + 1 < states:
            if time.monotonic() > deadline:
                raise RunError(
                    f"the simulator's diagnostics after its {states} states did not arrive"
                )
            self.hear(0.1)
        names = (UNANSWERED, LATE, IDLE, OVERDUE)
        return {name: int(self.diagnosis.get(name, 0)) for name in names}


def _node_processes() -> dict[str, int]:
    """Return this process's children that are nodes: name and pid."""
    found = {}
    for children in Path("/proc/self/task").glob("*/children"):
        for pid in children.read_text().split():
            with suppress(OSError):
                command = (Path("/proc") / pid / "cmdline").read_bytes().split(b"\0")
                names = {Path(os.fsdecode(part)).name for part in command[:2]}
                found |= {name: int(pid) for name in names & NODES.keys()}
    return found


def soak(plan: RunPlan, folder: Path, allowed: float) -> list[str]:
    """Run the plan, print what was seen, and return what is wrong. Raises RunError."""
    watch = Watch()
    files = RunFiles(folder)
    run_graph(plan, files, watch.look)
    watch.write_memory(folder / "memory.csv")
    recording = Recording.open(files.recording)
    steps = steps_of(recording)
    counted = watch.hear_the_last(steps.states)
    settled_s = settled_at(plan.simulator.duration)
    grown = [growth(node, samples, settled_s) for node, samples in watch.memory.items()]
    print_table(
        f"resident memory from {settled_s:g} s on",
        ("node", "settled, MiB", "most, MiB", "growth"),
        [
            (g.node, f"{g.settled / MIB:.2f}", f"{g.most / MIB:.2f}", f"{g.ratio:.2%}")
            for g in grown
        ],
    )
    print_table(
        f"steps: {steps.states} states",
        ("missed", "in the record", "counted"),
        [
            (UNANSWERED, str(steps.unanswered), str(counted[UNANSWERED])),
            (LATE, str(steps.late), str(counted[LATE])),
            (IDLE, str(steps.idle), str(counted[IDLE])),
            (OVERDUE, f"{steps.lost_s:.3f} s lost", str(counted[OVERDUE])),
        ],
    )
    absent = [f"{node}: its memory was not seen" for node in plan.configs.keys() - watch.memory]
    return [
        *absent,
        *problems_of_memory(grown, allowed),
        *problems_of_steps(steps, counted, seconds(plan.simulator.period_ns)),
        *problems_of_file(recording),
    ]


@click.command()
@click.option("--minutes", default=30.0, show_default=True, help="Length of the run.")
@click.option("--rate", default=200.0, show_default=True, help="Rate of the loop, Hz.")
@click.option(
    "--growth",
    "allowed",
    default=MAX_GROWTH,
    show_default=True,
    help="By which fraction a node's memory may grow once it has settled.",
)
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the recording, memory.csv and logs.  [default: a temporary one]",
)
def main(minutes: float, rate: float, allowed: float, output: Path | None) -> None:
    """Run for this long; exit code 1, with the reasons on one line, if something is wrong."""
    with tempfile.TemporaryDirectory(prefix="soak_") as folder:
        try:
            plan = make_plan(
                "demo",
                "fuzzy_pid",
                settings=NOISE,
                everywhere={"duration": 60.0 * minutes, "update_rate": rate},
            )
            files = RunFiles.for_run(plan, output or Path(folder))
            problems = soak(plan, files.folder, allowed)
        except (TrunkError, ValueError) as error:
            problems = [str(error)]
    if problems:
        sys.exit(f"check_soak: FAILED: {'; '.join(problems)}")
    click.echo(f"check_soak: {minutes:g} min at {rate:g} Hz passed")


if __name__ == "__main__":
    main()
