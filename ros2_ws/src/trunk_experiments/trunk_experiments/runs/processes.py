"""The node set's processes: started from the ament index, watched, stopped in order, never orphaned."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from trunk_msgs_util.node import early_signals
from trunk_msgs_util.source import process_id

from ..errors import ExecutableError

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


def _child_of(parent: int, enlist: Callable[[], None]) -> Callable[[], None]:
    def prepare() -> None:
        # System calls, which take no lock: safe between fork and exec.
        # A run that is killed must not leave its nodes behind, not even at this moment.
        # The guardian stops nodes that hang.
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
        early_signals.block()  # the executable takes them once it can
        enlist()
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
    def start(
        cls,
        name: str,
        command: Sequence[str],
        parameters: Path,
        log: Path,
        enlist: Callable[[], None] = lambda: None,
    ) -> NodeProcess:
        """Start a node by a command; stdout and stderr go to ``log``.

        ``enlist`` is called in the new process before it becomes the executable.
        """
        words = [*command, "--ros-args", "--params-file", str(parameters)]
        with log.open("wb") as stream:
            output = log.open("rb")
            process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches the runner alone, which stops in order
                preexec_fn=_child_of(os.getpid(), enlist),  # noqa: PLW1509
            )
        return cls(name, process, log, output, process_id(process.pid))

    @property
    def pid(self) -> int:
        """The process's id."""
        return self.process.pid

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
