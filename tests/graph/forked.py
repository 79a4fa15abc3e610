"""Executables begun as copies of a process that has loaded ROS 2, once for all tests of a session.

Each is a process of its own all the same, with its own environment, signals and DDS participant: only the
imports, more than half of a node's start, are not repeated.
"""

import faulthandler
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing import forkserver, get_context, resource_tracker
from pathlib import Path
from signal import SIGKILL

from trunk_msgs_util.node import early_signals

_CONTEXT = get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [
        "trunk_msgs_util.node.recorder_node",
        "trunk_sim.simulator_node",
        "trunk_sim.disturbance_node",
        "trunk_control.controller_node",
        "trunk_runs.graph",
        "trunk_experiments.cli",
    ]
)


class Forked:
    """A process, with what tests use of `subprocess.Popen`."""

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], folder: Path, name: str
    ) -> None:
        """``command``: the path of an executable, ``lib/PACKAGE/NAME``, and its arguments.

        ``name``: what it says goes to ``name.out`` and ``name.err`` in ``folder``.
        """
        root = str(Path(__file__).parents[2])
        if root not in sys.path:
            sys.path.append(root)  # where the process finds this module
        resource_tracker.ensure_running()  # which unblocks signals where it has to be started
        with early_signals.held():  # as `ros2 run` starts our executables
            forkserver.ensure_running()
        for ending in ("out", "err"):
            (folder / f"{name}.{ending}").write_bytes(b"")
        given = list(command), dict(environment), folder, name
        self._process = _CONTEXT.Process(target=_begin, args=given)
        self._process.start()
        assert self._process.pid is not None
        self.pid: int = self._process.pid
        self.args = list(command)

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self) -> int | None:
        self._process.join()
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with suppress(ProcessLookupError):  # it has just ended
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(SIGKILL)


def server() -> int:
    """Return the process that the others are copied from."""
    return int(forkserver._forkserver._forkserver_pid)  # type: ignore[attr-defined]


def end() -> None:
    """End the process that the others were copied from, so that its time counts as the session's."""
    forkserver._forkserver._stop()  # type: ignore[attr-defined]


def _begin(command: list[str], environment: dict[str, str], folder: Path, name: str) -> None:
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    for number, ending in ((1, "out"), (2, "err")):
        file = os.open(folder / f"{name}.{ending}", os.O_WRONLY)
        os.dup2(file, number)
        os.close(file)
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", 1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    faulthandler.enable(sys.stderr)
    sys.argv = command
    package, executable = Path(command[0]).parts[-2:]
    sys.exit(getattr(import_module(f"{package}.executables"), executable)())
