"""Real processes on two hosts, which a test may cut off from each other."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from ..failed import FAILED
from ..graph.conftest import domain, domains  # noqa: F401 (fixtures)
from ..graph.processes import Child
from .hosts import Host, network, why_not
from .listener import Listener


@pytest.fixture(scope="session")
def namespaces() -> None:
    """Skip where this machine does not let us make any."""
    if reason := why_not():
        pytest.skip(reason)


@pytest.fixture
def hosts(
    namespaces: None,
    domain: int,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> Iterator[tuple[Host, ...]]:
    """Make two hosts whose nodes look for each other on the subnet."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    with network(tmp_path, lambda: request.node.stash.get(FAILED, False)) as made:
        yield made


@pytest.fixture
def listener(hosts: tuple[Host, ...]) -> Iterator[Listener]:
    """Listen on the first host."""
    started = Listener(hosts[0])
    yield started
    started.close()


@pytest.fixture
def server(hosts: tuple[Host, ...], monkeypatch: pytest.MonkeyPatch) -> Iterator[Child]:
    """Run a discovery server on the first host; the switch floods no multicast, as on many networks."""
    for host in hosts:
        host.without_multicast()
    script = Path(__file__).parents[2] / "scripts" / "discovery_server.sh"
    started = hosts[0].children.start("discovery_server", script)
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", f"{hosts[0].address}:11811")
    yield started
    started.stop(signal.SIGTERM)
