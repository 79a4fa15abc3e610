"""The node set's processes: started from the ament index, watched, stopped in order, never orphaned."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from trunk_msgs_util.deadline import Deadline
from trunk_msgs_util.node import early_signals
from trunk_msgs_util.source import HeldError, claimed, process_id

from ..errors import ExecutableError, RunError


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
_OURS = ("trunk_msgs_util", "trunk_sim", "trunk_control", "trunk_experiments")
_LIBC = ctypes.CDLL(None)


def find_executable(package: str, executable: str) -> Path:
    """Return the path that ``ros2 run package executable`` would run. Raises ExecutableError.

    The executable of a package that pip installed is looked for on the PATH.
    """
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix) / "lib" / package / executable
        if prefix and os.access(path, os.X_OK):
            return path
    if package not in _OURS:  # a controller's package that pip installed
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
