"""A run in the real graph: start the node set, watch it, stop it in order, leave nothing behind."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from dataclasses import replace as with_values
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from .nodes import NODES
from .plan import PlanError, RunPlan
from .processes import NodeProcess, stop

if TYPE_CHECKING:
    from .monitor_node import Monitor

START_TIMEOUT_S = 30.0
COMPOSED = "composed"


class RunError(RuntimeError):
    """A run that ended otherwise than it should: who, why."""


@dataclass(frozen=True)
class RunFiles:
    """Where a run leaves what it makes."""

    folder: Path

    @classmethod
    def for_run(cls, plan: RunPlan, folder: Path | None = None) -> RunFiles:
        """Make the run's folder, by default a new one below ``runs``. Raises PlanError."""
        if folder is None:
            stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
            place = plan.namespace.replace("/", "_")
            folder = Path("runs") / f"{stamp}_{plan.scenario}_{plan.controller_name}{place}"
        if (folder / "run.mcap").exists():
            raise PlanError(f"output {folder}: there is a run.mcap in it; give another folder")
        folder.mkdir(parents=True, exist_ok=True)
        return cls(folder)

    @property
    def recording(self) -> Path:
        """The MCAP file."""
        return self.folder / "run.mcap"

    @property
    def parameters(self) -> Path:
        """Every node's full parameters, ready for ``--params-file``."""
        return self.folder / "params.yaml"

    def record(self, plan: RunPlan) -> RunPlan:
        """Return the plan that records into this folder, and write it as the parameter file."""
        plan = with_values(
            plan, recorder=with_values(plan.recorder, output=str(self.recording.absolute()))
        )
        plan.write_parameters(self.parameters)
        return plan

    def log(self, node: str) -> Path:
        """Return where a node's console output goes."""
        return self.folder / "logs" / f"{node}.log"


class _Interrupt:
    """SIGINT and SIGTERM to the runner, kept until the watch looks: nothing is left half started."""

    def __init__(self) -> None:
        self.name: str | None = None
        self._handlers = {n: signal.signal(n, self._note) for n in (signal.SIGINT, signal.SIGTERM)}

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.name = signal.Signals(number).name

    def restore(self) -> None:
        """Put the former handlers back."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)


def run_graph(
    plan: RunPlan,
    files: RunFiles,
    progress: Callable[[float], None],
    order: Sequence[str] | None = None,
    composed: bool = False,
) -> None:
    """Run the plan's nodes, as processes or ``composed`` in one, until the simulator is done.

    ``progress`` is called with simulated seconds. ``order``: the nodes' names in the order of their
    start (it makes no difference to a lock-step run). Raises RunError naming the node that ended the
    run and why; by then every process has been stopped and the recording finished.
    """
    (files.folder / "logs").mkdir(parents=True, exist_ok=True)
    plan = files.record(plan)
    running: dict[str, NodeProcess] = {}
    interrupt = _Interrupt()
    try:
        names = list(plan.configs)
        for process in [COMPOSED] if composed else order or names:
            running[process] = NodeProcess.start(
                process,
                "trunk_experiments" if composed else NODES[process].package,
                names if composed else [],
                files.parameters,
                files.log(process),
            )
        from .monitor_node import Monitor  # here: it has threads, and starting processes must not

        with Monitor() as monitor:
            _watch(running, monitor, progress, interrupt)
    finally:
        _stop_all(running)
        interrupt.restore()


def _watch(
    running: dict[str, NodeProcess],
    monitor: Monitor,
    progress: Callable[[float], None],
    interrupt: _Interrupt,
) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    simulator = running.get(COMPOSED) or running["simulator"]
    while simulator.exit_code is None:
        monitor.spin(0.05)
        if interrupt.name:
            raise RunError(f"stopped by {interrupt.name}; the recording holds the run up to here")
        _check_alive(running, simulator)
        if not monitor.started:
            doubled = monitor.doubled(list(running))
            if doubled:
                raise RunError(
                    f"another {doubled[0]} is running in this ROS domain: stop it, "
                    "or set ROS_DOMAIN_ID to another number"
                )
            if time.monotonic() > deadline:
                silent = ", ".join(set(running) - monitor.ready - {"simulator"}) or "simulator"
                raise RunError(
                    f"the run did not start within {START_TIMEOUT_S:g} s: {silent} not ready"
                )
        progress(monitor.time)
    if simulator.exit_code != 0:
        _hear_last_words(monitor)
        raise RunError(monitor.failure or simulator.describe_end())


def _hear_last_words(monitor: Monitor) -> None:
    deadline = time.monotonic() + 0.5
    while monitor.failure is None and time.monotonic() < deadline:
        monitor.spin(0.05)


def _check_alive(running: dict[str, NodeProcess], simulator: NodeProcess) -> None:
    for process in running.values():
        if process is not simulator and process.exit_code is not None:
            raise RunError(f"the run ended because {process.describe_end()}")


def _stop_all(running: dict[str, NodeProcess]) -> None:
    """Stop the simulator first, so that the others hear its end, and the recorder last."""
    order = sorted(running, key=lambda name: (name == "recorder", name != "simulator"))
    for name in order:
        stop(running[name])
