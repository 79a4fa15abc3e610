"""The node set: its command lines for ``ros2 launch`` and for us, and its processes.

What to start follows from a plan, and ``launch`` is not needed for it. Processes are started from the ament
index, watched, stopped in order, never orphaned.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from trunk_core import PACKAGES, topics
from trunk_core.deadline import Deadline
from trunk_core.errors import ExecutableError, PlanError, RunError
from trunk_msgs_util.node import early_signals
from trunk_msgs_util.source import HeldError, claimed, process_id
from trunk_recording.reader import Recording, RecordingError

from .nodes import CONTROLLERS, NODES
from .plan import RunPlan, make_plan

RECORDER = "recorder"
SIMULATOR = "simulator"
# Of the launch file, NAME:=VALUE: the default, and what it is. More goes into parameter files.
ARGUMENTS = {
    "scenario": ("demo", "fig6, fig7, fig8, fig9, demo, cart_pole, or a parameter file's path"),
    "controller": ("fuzzy_pid", f"one of {', '.join(CONTROLLERS)}"),
    "params": (
        "",
        "parameter files by path or shipped name, separated by commas; later ones win",
    ),
    "lockstep": ("false", "step when every node has answered: the same bits each time"),
    "output": ("", "folder for the recording; empty: runs/TIME_SCENARIO_CONTROLLER"),
}


@dataclass(frozen=True)
class LaunchNode:
    """One process: where its executable lies, and what follows ``--ros-args``."""

    package: str
    executable: str
    ros_arguments: tuple[str, ...]


def launch_plan(given: Mapping[str, str]) -> RunPlan:
    """Return the plan that the launch arguments ask for. Raises what `make_plan` does."""
    lockstep = given["lockstep"].strip().lower()
    if lockstep not in ("true", "false"):
        raise PlanError(f"lockstep:={given['lockstep']} is not allowed: true or false")
    return make_plan(
        given["scenario"],
        given["controller"],
        [part.strip() for part in given["params"].split(",") if part.strip()],
        everywhere={"lockstep.enabled": True} if lockstep == "true" else {},
    )


def _in_namespace(namespace: str) -> tuple[str, ...]:
    # /clock is the one absolute topic that a second simulator would spoil; /diagnostics names its nodes.
    return ("-r", f"__ns:={namespace}", "-r", "/clock:=clock") if namespace else ()


def launch_nodes(plan: RunPlan, parameters: Path) -> list[LaunchNode]:
    """Return the nodes of a run in the order of their start, the recorder first."""
    arguments = ("--params-file", str(parameters), *_in_namespace(plan.namespace))
    return [LaunchNode(NODES[name].package, name, arguments) for name in plan.configs]


def next_to_stop(running: Sequence[str]) -> list[str]:
    """Return the nodes to stop next once one has ended; empty: the rest may go.

    The simulator goes first, so that the others hear its end, and the recorder last, so that it hears all.
    """
    if SIMULATOR in running:
        return [SIMULATOR]
    return [name for name in running if name != RECORDER]


def what_lacks(file: Path) -> str:
    """Return why a run's recording is not whole, naming it; empty for a complete one."""
    try:
        recording = Recording.open_by_summary(file)
    except RecordingError as error:
        return str(error)
    if recording.complete:
        return ""
    return f"{file}: incomplete: {(recording.end or {}).get('reason', 'no end marker')}"


def connection_lines(plan: RunPlan) -> list[str]:
    """Return in five lines what a node that gives the commands subscribes to and publishes."""
    hip, trunk = plan.simulator.joints
    kind = topics.JOINT_STATE_TYPE
    plant = plan.simulator.kind
    units = ", ".join(coordinate.unit for coordinate in plant.coordinates)
    effort = plant.driven.effort_unit
    at = f"{plan.namespace}/"
    reference = (
        f"{kind}: {trunk}, position [rad], of the state with its stamp, one step ahead"
        if plan.reference is not None
        else f"{kind}: nobody of ours publishes it (reference.profile is topic)"
    )
    rule = (
        "the state's, copied: it answers that state, and the plant waits for it"
        if plan.simulator.lockstep
        else "the state's, copied: it answers that state; without one it acts when it arrives"
    )
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    return [
        f"connect your node, with ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE={reach}:",
        f"  hears {at}{topics.JOINT_STATES}: {kind}: {hip}, {trunk}, position [{units}], velocity; reliable",
        f"  hears {at}{topics.REFERENCE}: {reference}; reliable",
        f"  sends {at}{topics.EFFORT_COMMAND}: {kind}: {trunk}, effort [{effort}]; reliable or best effort",
        f"  header.stamp of a command: {rule}",
    ]


@contextmanager
def claimed_domain() -> Iterator[None]:
    """Hold this machine's ROS domain, which ``ROS_DOMAIN_ID`` names, for one run.

    Raises RunError naming the process that holds it.
    """
    domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)
    try:
        token = claimed(f"run {domain}")
    except HeldError as error:
        holder = f", in process {error}" if str(error) else ""
        raise RunError(
            f"another run is under way in ROS domain {domain}{holder}: stop it or wait for its "
            "end, or set ROS_DOMAIN_ID to another number"
        ) from None
    with token:
        yield


_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None)


def find_executable(package: str, executable: str) -> Path:
    """Return the path that ``ros2 run package executable`` would run. Raises ExecutableError.

    The executable of a package that pip installed is looked for on the PATH.
    """
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix) / "lib" / package / executable
        if prefix and os.access(path, os.X_OK):
            return path
    if package not in PACKAGES:  # a controller's package that pip installed
        command = shutil.which(executable)
        if command is not None:
            return Path(command)
        raise ExecutableError(
            f"executable {executable!r} of package {package!r} is not found: build it beside the "
            "project's packages, or install it with pip so that it is on the PATH"
        )
    raise ExecutableError(
        f"executable {executable!r} of package {package!r} is not installed: "
        "in the project's sources, run scripts/bootstrap.sh, which gets ROS 2, then 'source scripts/env.sh'"
    )


def check_nodes_installed() -> None:
    """Raise ExecutableError if there are no nodes to run, as in a pip installation without ROS 2."""
    find_executable("trunk_sim", "simulator")


def _child_of(parent: int) -> Callable[[], None]:
    def prepare() -> None:
        # System calls, which take no lock: safe between fork and exec.
        # A run that is killed must not leave its nodes behind, not even at this moment.
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
        early_signals.block()  # the executable takes them once it can
        if os.getppid() != parent:
            os._exit(0)

    return prepare


@dataclass
class NodeProcess:
    """One node's process and its log."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    output: BinaryIO  # the log to read, even where its folder has been deleted
    identity: str  # as `process_id` gives it

    @classmethod
    def start(cls, name: str, command: Sequence[str], parameters: Path, log: Path) -> NodeProcess:
        """Start a node by a command; stdout and stderr go to ``log``."""
        words = [*command, "--ros-args", "--params-file", str(parameters)]
        with log.open("wb") as stream:
            output = log.open("rb")
            process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches the runner alone, which stops in order
                preexec_fn=_child_of(os.getpid()),  # noqa: PLW1509
            )
        return cls(name, process, log, output, process_id(process.pid))

    @property
    def ended(self) -> bool:
        """True once the process has ended."""
        return self.exit_code is not None

    @property
    def exit_code(self) -> int | None:
        """The exit code, None while the process runs, negative for a signal."""
        return self.process.poll()

    def signal(self, number: int) -> None:
        """Send a signal where the process still runs."""
        if self.exit_code is None:
            self.process.send_signal(number)

    def describe_end(self) -> str:
        """Return how the process ended, with the last line of its log."""
        code = self.exit_code
        if code is None:
            how = "is still running"
        elif code < 0:
            how = f"was ended by {signal.Signals(-code).name}"
        else:
            how = f"ended with exit code {code}"
        self.output.seek(0)
        lines = self.output.read().decode("utf-8", errors="replace").strip().splitlines()
        return f"{self.name} {how}" + (f": {lines[-1]}" if lines else f" (log: {self.log})")


# A node that ends hands its evidence over within 3 s.
FIRST_S = 3.7
# For all: the recorder, too, needs up to 4 s. A death is noticed, and its reason read, within 0.6 s.
ALL_S = 8.0
_POLL_S = 0.02


def stop(
    first: Sequence[NodeProcess],
    last: Sequence[NodeProcess],
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> list[NodeProcess]:
    """Tell all of ``first`` to end, and ``last`` when they have; kill those that do not.

    ``last`` is the recorder: it has to record the others' last messages. Return those that had to be killed;
    none is left running.
    """
    total = Deadline(ALL_S, clock)
    killed = _end(first, [Deadline(FIRST_S, clock), total], sleep)
    return killed + _end(last, [total], sleep)


def _end(
    processes: Sequence[NodeProcess], limits: Sequence[Deadline], sleep: Callable[[float], None]
) -> list[NodeProcess]:
    for process in processes:
        process.signal(signal.SIGINT)
    while (hung := _left(processes)) and not any(limit.passed for limit in limits):
        sleep(_POLL_S)
    for process in hung:
        process.signal(signal.SIGKILL)
    while _left(hung):
        sleep(_POLL_S)
    return hung


def _left(processes: Sequence[NodeProcess]) -> list[NodeProcess]:
    return [process for process in processes if not process.ended]
