"""Half an hour of the graph in real time: flat memory, every missed step counted, a whole file.

    source scripts/env.sh && python scripts/check_soak.py [--minutes 30] [--rate 200] [--output FOLDER]

Simulator, disturbance, Fuzzy-PID and recorder run as `scripts/run.sh` runs them. Memory is each process's
resident set (RSS of /proc/PID/smaps_rollup), read once a second from outside; after the first minute
(in a run shorter than two minutes: after its first half) it may grow by less than 2 %.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import defaultdict
from contextlib import suppress
from pathlib import Path

import click
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.nodes import resident_bytes
from benchmarks.soak import (
    IDLE,
    LATE,
    MAX_GROWTH,
    OVERDUE,
    UNANSWERED,
    growth,
    problems_of_file,
    problems_of_memory,
    problems_of_steps,
    settled_at,
    steps_of,
)

from trunk_experiments.console.tables import print_table
from trunk_experiments.errors import RunError
from trunk_experiments.plans.nodes import NODES
from trunk_experiments.plans.plan import RunPlan, make_plan
from trunk_experiments.runs.graph import run_graph
from trunk_experiments.runs.run_files import RunFiles
from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.node import middleware
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.units import seconds

MIB = 2**20
EVERY_S = 1.0
HUNG_S = 60.0
# Each command then differs from the one before, so that a step made with the wrong one shows.
NOISE = ("simulator.sensor.position_noise=1e-4", "simulator.sensor.velocity_noise=1e-3")


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
