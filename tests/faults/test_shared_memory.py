"""Shared memory that is short or full, in a mount namespace of the test's own: UDP, or one line."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from trunk_msgs_util.node import middleware
from trunk_msgs_util.recording.reader import Recording

from ..failed import FAILED
from ..graph.processes import Children

pytestmark = pytest.mark.graph

_MOUNT = "mount -t tmpfs -o size={size} trunk-test /dev/shm"


@pytest.fixture
def within(
    tmp_path: Path, domain: int, request: pytest.FixtureRequest
) -> Iterator[Callable[[str], Children]]:
    """Return what makes children that have shared memory of a given size."""
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


def test_run_with_little_shared_memory_uses_udp(within: Callable[[str], Children]) -> None:
    children = within("64k")
    run = children.trunk("run", "demo", "--duration", 1, "--lockstep", "--output", "run")
    assert run.wait() == 0, run.stderr
    told = [line for line in run.stderr.splitlines() if "/dev/shm" in line]
    assert told == [
        "/dev/shm has 64 kB free, 3320 kB are needed: messages go by UDP instead of shared memory"
    ]
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


def test_settings_that_are_there_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(middleware.TRANSPORTS, "SHM")
    middleware.prepare(10**9, tmp_path)
    monkeypatch.delenv(middleware.TRANSPORTS)
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
    middleware.prepare(10**9, tmp_path)
    middleware.prepare(1, tmp_path / "missing")
    assert capsys.readouterr().err == ""
