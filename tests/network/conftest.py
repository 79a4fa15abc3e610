"""Real processes on two hosts, which a test may part from one another."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ..graph.conftest import domain, domains  # noqa: F401 (fixtures)
from ..graph.peer import Peer
from .hosts import Host, network, why_not


@pytest.fixture(scope="session")
def namespaces() -> None:
    """Skip where this machine lets us make none."""
    if reason := why_not():
        pytest.skip(reason)


@pytest.fixture
def hosts(
    namespaces: None,
    domain: int,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[tuple[Host, ...]]:
    """Make two hosts whose nodes look for one another on the subnet."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    with network(tmp_path) as made:
        yield made


@pytest.fixture
def peer(hosts: tuple[Host, ...]) -> Iterator[Peer]:
    """Give the test a node of its own, on the first host."""
    with hosts[0].entered():
        listener = Peer()
    yield listener
    listener.close()
