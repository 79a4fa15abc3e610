"""Tests of the graph in the virtual world of tests/seeds: python -m pytest -p tests.graph.virtual -m virtual.

The test is a process of the world, as its nodes are, and time is virtual for it as well. The test's name and
TRUNK_SEED, else the epoch (conftest.py), draw how long messages and discovery take.
"""

import os
import signal
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any
from zlib import crc32

if os.environ.get("PYTHONHASHSEED") != "0":  # as for seeds: the order of sets counts
    os.environ["PYTHONHASHSEED"] = "0"
    os.execv(sys.executable, sys.orig_argv)

import pytest
import yaml
from _pytest.runner import runtestprotocol

from ..seeds import nodes, rcl
from ..seeds.world import NS, HungError, Process, World
from . import processes

_LIMIT_NS = 200 * NS  # virtual
_FIRST = 5_000_000  # a number that no process of Linux has
_kill = os.kill


class Virtual:
    """A process with what tests use of `subprocess.Popen`, in place of `forked.Forked`."""

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], folder: Path, name: str
    ) -> None:
        self.args, node = list(command), Path(command[0]).name
        given: dict[str, Any] = {}
        renamed: dict[str, str] = {}
        for flag, word in pairwise(command):
            key, _, value = word.partition(":=")
            if flag == "-p":
                given[key] = _typed(node, key, yaml.safe_load(value))
            elif flag == "-r":
                renamed[key] = value
            elif flag == "--params-file":
                for own in yaml.safe_load(Path(word).read_text())[f"/{node}"].values():
                    given |= {key: _typed(node, key, value) for key, value in own.items()}
        os.chdir(folder)
        (folder / f"{name}.out").touch()
        own_stderr = (folder / f"{name}.err").open("w", 1, errors="backslashreplace")
        run = nodes.executable(node, command)

        def main() -> int:
            try:
                return run()
            except Exception:
                traceback.print_exc()
                return 1

        self._process = rcl.world().start(name, main, {"*": given})
        self._process.renamed = renamed
        self._process.log = _Log(own_stderr)
        self._process.stderr = own_stderr
        self.pid = self._process.number

    @property
    def returncode(self) -> int | None:
        return -signal.SIGKILL if self._process.crashed else self._process.exit_code

    def poll(self) -> int | None:
        return self.returncode

    def wait(self) -> int | None:
        return processes.until(lambda: self.returncode is not None, "it ends") and self.returncode

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class _Log(list[str]):
    def __init__(self, file: Any) -> None:
        self._file = file

    def append(self, line: str) -> None:
        super().append(line)
        print(line, file=self._file)


def _typed(node: str, key: str, value: Any) -> tuple[str, Any]:
    """Return a value's type, as ROS 2 finds it, and the value."""
    several = isinstance(value, list)
    if value == []:
        return nodes.kind_of(node, key), value
    one = value[0] if several else value
    kind = {bool: "BOOL", int: "INTEGER", float: "DOUBLE", str: "STRING"}[type(one)]
    return kind + "_ARRAY" * several, value


def _send(pid: int, number: int) -> None:
    if pid < _FIRST:
        return _kill(pid, number)
    process = rcl.world().processes[pid - _FIRST]
    if number == signal.SIGKILL:
        rcl.world().crash(process)
    elif number == signal.SIGSTOP:
        rcl.world().hold(process)
    elif number == signal.SIGCONT:
        rcl.world().let_go(process)
    else:
        rcl.world().signal(process, number)
    return None


def _own_stderr(world: World) -> Callable[[Process | None], None]:
    """Return what lets each process write to its own stderr."""
    switched, kept, entered = world.switched, [], []

    def switch(process: Process | None) -> None:
        switched(process)
        if process is None:
            entered.pop().stderr = sys.stderr
            sys.stderr = kept.pop()
        else:
            kept.append(sys.stderr)
            entered.append(process)
            sys.stderr = process.stderr or sys.stderr

    return switch


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """Run a test, its fixtures as well, as a process of a world of its own."""
    seed = os.environ.get("TRUNK_SEED", os.environ["TRUNK_EPOCH"])
    world = nodes.new_world(crc32(f"{item.nodeid}{seed}".encode()))
    world.switched = _own_stderr(world)
    world.network.loss = 0.0  # as on one machine
    world.first = _FIRST
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    test = world.start("test", lambda: bool(runtestprotocol(item, nextitem=nextitem)), {})
    while test.alive:
        try:
            world.run(lambda: not test.alive, world.now_ns + _LIMIT_NS, most=10**8)
        except HungError as error:
            world.give_up(test, error)
    world.bury()
    os.chdir(item.config.rootpath)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


processes.Forked = Virtual  # type: ignore[assignment, misc]
os.kill = _send
