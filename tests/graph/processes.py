"""Processes under test: started, found again wherever they come from, never left behind."""

import os
import re
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from trunk_core.deadline import Deadline
from trunk_runs.nodes import NODES
from trunk_runs.processes import find_executable

from .forked import Forked

# A process that was asked to end, directly or by its parent, may take this long.
_LEFT_S = 300.0
_TOKEN = "TRUNK_TEST_TOKEN"
_PATIENCE = "4"  # of a run, which a busy machine may hold up
# For `trunk params`: its own limit is shorter than a busy machine may hold a node up.
PATIENT = ("--timeout", 600)


def until(condition: Callable[[], Any], what: str, pause_s: float = 0.01) -> Any:
    """Poll until the condition is truthy, and return it.

    A busy machine may take its time. What hangs is ended by pytest's timeout (pyproject.toml), whose
    report shows this call and ``what`` is waited for.
    """
    while not (found := condition()):
        time.sleep(pause_s)
    return found


@dataclass
class Child:
    """A process that a test started; what it says goes to files, so that it never blocks."""

    name: str
    process: subprocess.Popen[bytes] | Forked
    folder: Path

    @property
    def stdout(self) -> str:
        """What it has printed."""
        return (self.folder / f"{self.name}.out").read_text(errors="replace")

    @property
    def stderr(self) -> str:
        return (self.folder / f"{self.name}.err").read_text(errors="replace")

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    @property
    def exit_code(self) -> int | None:
        """None while it runs, and if it was killed."""
        code = self.process.poll()
        return None if code is None or code < 0 else code

    @property
    def log(self) -> list[str]:
        return self.stderr.splitlines()

    def send(self, number: int) -> None:
        self.process.send_signal(number)

    def wait(self) -> int:
        """Return the exit code, once the process has ended."""
        try:
            until(lambda: self.process.poll() is not None, f"{self.name} ends", 0.002)
        except pytest.fail.Exception as error:
            if isinstance(self.process, Forked) and self.process.poll() is None:
                self.send(signal.SIGABRT)  # it writes down where it is
                self.process.wait()
            raise AssertionError(f"{self.name} does not end\n{self.stderr}") from error
        assert self.process.returncode is not None
        return self.process.returncode

    def stop(self, number: int = signal.SIGINT) -> int:
        """Send a signal, wait for the end and return the exit code."""
        self.send(number)
        return self.wait()


class Children:
    """Starts processes, finds those that they start, and sees that none is left."""

    def __init__(self, folder: Path, through: Sequence[str] = ()) -> None:
        """``through``: a command that runs its arguments, such as ``ip netns exec NAME``."""
        self.folder = folder
        self._through = through
        self.environment = {_TOKEN: uuid.uuid4().hex}  # by it we know our own, however indirect
        self._started: list[Child] = []

    def start(self, name: str, *command: object) -> Child:
        out, err = self.folder / f"{name}.out", self.folder / f"{name}.err"
        with out.open("wb") as stdout, err.open("wb") as stderr:
            process = subprocess.Popen(
                [str(part) for part in (*self._through, *command)],
                cwd=self.folder,
                env={**os.environ, **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
            )
        self._started.append(Child(name, process, self.folder))
        return self._started[-1]

    def node(self, executable: str, *ros_arguments: object, name: str = "") -> Child:
        """Start a node's executable; an argument ``NAME:=VALUE`` sets a parameter."""
        path = find_executable(NODES[executable].package, executable)
        arguments = []
        for argument in map(str, ros_arguments):
            rule = ":=" in argument and not argument.startswith("__")
            arguments += ["-p", argument] if rule else [argument]
        given = ["--ros-args", *arguments] if arguments else []
        return self.fork(name or executable, path, *given)

    def trunk(self, *arguments: object, name: str = "trunk") -> Child:
        """Start the ``trunk`` command."""
        with pytest.MonkeyPatch.context() as environment:
            environment.setenv("TRUNK_PATIENCE", os.environ.get("TRUNK_PATIENCE", _PATIENCE))
            return self.fork(name, find_executable("trunk_experiments", "trunk"), *arguments)

    def fork(self, name: str, *command: object) -> Child:
        """Start one of our executables without loading it anew, but for one that goes through a command."""
        if self._through:
            return self.start(name, *command)
        words = [str(word) for word in command]
        process = Forked(words, {**os.environ, **self.environment}, self.folder, name)
        self._started.append(Child(name, process, self.folder))
        return self._started[-1]

    def python(self, code: str, *arguments: object, name: str = "python") -> Child:
        """Start a script, given as text."""
        return self.start(name, sys.executable, "-c", code, *arguments)

    def pids(self) -> dict[int, str]:
        """Return pid and command line of every live process that began here."""
        ((key, value),) = self.environment.items()
        forked = (child.process for child in self._started if isinstance(child.process, Forked))
        found = {one.pid: " ".join(one.args) for one in forked if one.poll() is None}
        for entry in Path("/proc").iterdir():
            with suppress(OSError):
                if entry.name.isdigit() and f"{key}={value}".encode() in (
                    (entry / "environ").read_bytes().split(b"\0")
                ):
                    arguments = (entry / "cmdline").read_bytes().split(b"\0")
                    found[int(entry.name)] = " ".join(map(os.fsdecode, arguments)).strip()
        return found

    def pid_of(self, executable: str) -> int:
        """Wait for the process of a node's executable, whoever started it, and return its pid."""
        wanted = re.compile(rf"lib/trunk_\w+/{executable}( |$)")

        def find() -> list[int]:
            return [pid for pid, line in self.pids().items() if wanted.search(line)]

        return int(until(find, f"{executable} runs")[0])

    def none_left(self) -> None:
        """Wait until nothing that began here is alive any more."""
        until(lambda: not self.pids(), f"every process has ended: {self.pids()}", 0.05)

    def close(self, failed: bool = False) -> None:
        """Fail the test where something has to be killed; where it has failed, kill at once."""
        deadline = Deadline(0.0 if failed else _LEFT_S)
        while (left := self.pids()) and not deadline.passed:
            time.sleep(0.02)
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for child in self._started:
            child.process.wait()
        assert failed or not left, f"left behind, and killed: {left}"
