"""Shared memory that is scarce or full, and settings that ROS 2 cannot use: either is named in a line."""

import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from trunk_control.controller_node import ControllerNode
from trunk_control.pid import LAW
from trunk_core.parameters.declarations import ParameterError
from trunk_msgs_util.node import middleware
from trunk_recording.reader import Recording

from ..failed import FAILED
from ..graph.processes import PATIENT, Children, until

pytestmark = pytest.mark.graph

_MOUNT = "mount -t tmpfs -o size={size} trunk-test /dev/shm"


@pytest.fixture
def within(
    tmp_path: Path, domain: int, request: pytest.FixtureRequest
) -> Iterator[Callable[[str], Children]]:
    """Return a function that makes `Children` with shared memory of a given size, in a mount namespace."""
    made: list[Children] = []

    def with_size(size: str) -> Children:
        mount = _MOUNT.format(size=size)
        tried = subprocess.run(
            ["unshare", "-m", "sh", "-c", mount], capture_output=True, check=False
        )
        if tried.returncode:
            pytest.skip("no shared memory of a test's own can be mounted here (root is needed)")
        made.append(
            Children(tmp_path, ("unshare", "-m", "sh", "-c", f'{mount} && exec "$@"', "sh"))
        )
        return made[-1]

    yield with_size
    for children in made:
        children.close(request.node.stash.get(FAILED, False))


def test_run_needs_no_shared_memory(within: Callable[[str], Children]) -> None:
    children = within("64k")
    run = children.trunk("run", "demo", "--duration", 1, "--lockstep", "--output", "run")
    assert run.wait() == 0, run.stderr
    assert "shm" not in run.stderr + run.stdout
    assert Recording.open(children.folder / "run" / "run.mcap").complete


def test_full_shared_memory_is_named(within: Callable[[str], Children]) -> None:
    children = within("4k")
    run = children.trunk("run", "demo", "--duration", 1, "--output", "run")
    assert run.wait() == 2
    assert run.stderr.splitlines()[-1].startswith(
        "trunk: error: /dev/shm is full (4096 bytes free): "
    )
    node = children.node("simulator")
    assert node.wait() == 2
    assert node.stderr.startswith("simulator: error: /dev/shm is full (4096 bytes free): ")
    assert len(node.stderr.splitlines()) == 1


def test_no_message_goes_through_shared_memory(
    children: Children, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that opens a port there takes its owner for dead if it does not answer in time."""
    for name in (middleware.TRANSPORTS, middleware.PROFILES_FILE):
        monkeypatch.delenv(name, raising=False)  # the processes choose for themselves
    node = children.node("pid")
    asked = children.trunk("params", "set", *PATIENT, "pid", "gains.p=70", name="asked")
    assert asked.wait() == 0, asked.stderr
    mapped = Path(f"/proc/{children.pid_of('pid')}/maps").read_text()
    assert "librmw_fastrtps" in mapped
    assert "fastrtps_port" not in mapped
    assert node.stop() == 0


def taken_by(pids: Iterable[int]) -> set[Path]:
    """Return the files of Fast DDS's shared memory that processes use, one of each participant."""
    found: set[str] = set()
    for pid in pids:
        with suppress(OSError):  # it has ended
            found.update(re.findall("/dev/shm/fastrtps_.*", Path(f"/proc/{pid}/maps").read_text()))
    return {Path(file) for file in found}


RUN = ("run", "demo", "--output", "run")
ENDS = {
    "lock-step": (5, (*RUN, "--lockstep", "--duration", 3), 0),
    "composed": (2, (*RUN, "--composed", "--duration", 3), 0),
    "real time": (5, (*RUN, "--duration", 3), 0),
    "Ctrl-C": (5, RUN, signal.SIGINT),
    "node, SIGINT": (1, "simulator", signal.SIGINT),
    "node, SIGTERM": (1, "simulator", signal.SIGTERM),
}


@pytest.mark.parametrize("end", ENDS)
def test_no_shared_memory_is_left(children: Children, end: str) -> None:
    participants, started, number = ENDS[end]
    child = children.node(started) if isinstance(started, str) else children.trunk(*started)
    taken: set[Path] = set()

    def all_met() -> bool:
        taken.update(taken_by(children.pids()))
        return len(taken) == participants or not child.alive

    until(all_met, f"{participants} participants")
    child.stop(number) if number else child.wait()
    assert taken
    assert [file for file in taken if file.exists()] == []


def test_a_refused_node_leaves_no_shared_memory(arguments: Callable[..., None]) -> None:
    before = taken_by([os.getpid()])
    arguments("gains.p:=-7.0")
    with pytest.raises(ParameterError):
        ControllerNode(LAW)
    assert taken_by([os.getpid()]) == before


def test_the_users_settings_are_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    mine = tmp_path / "mine.xml"
    mine.write_text("<profiles/>")

    def prepared(**given: str) -> str | None:
        for name in (middleware.TRANSPORTS, middleware.PROFILES_FILE):
            monkeypatch.delenv(name, raising=False)
        for name, value in given.items():
            monkeypatch.setenv(name, value)
        middleware.prepare()
        return os.environ.get(middleware.PROFILES_FILE)

    assert prepared() == str(middleware.PROFILES)
    assert prepared(**{middleware.PROFILES_FILE: str(mine)}) == str(mine)
    assert prepared(**{middleware.TRANSPORTS: "SHM"}) is None


SETTINGS = [
    ("ROS_DOMAIN_ID", "abc"),
    ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
    ("HOME", "/proc/none"),
    ("ROS_LOG_DIR", "/proc/none"),
    ("RMW_IMPLEMENTATION", "rmw_none"),
]


@pytest.mark.parametrize(("name", "value"), SETTINGS)
def test_setting_is_named_in_one_line(
    children: Children, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(name, value)
    started = {
        "trunk": children.trunk("run", "demo", "--output", "run"),
        "simulator": children.node("simulator"),
    }
    for program, child in started.items():
        assert child.wait() == 2
        assert child.stderr.splitlines()[-1].startswith(f"{program}: error: {name}={value}")
        assert "Traceback" not in child.stderr
    assert len(started["simulator"].stderr.splitlines()) == 1
    assert list(children.folder.glob("run/logs/*")) == []
