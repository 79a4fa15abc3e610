"""Real processes over real DDS: each test has its own ROS domain and leaves no process behind."""

import gc
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from trunk_msgs_util.node import middleware

from ..failed import FAILED
from . import forked
from .peer import Peer
from .processes import Children

_DOMAINS = 100  # beyond, DDS's ports run into those that the kernel hands out
_DDS_PORT, _PORTS_PER_DOMAIN = 7410, 250
_LOCK = "trunk-test-domain-{}"  # an abstract socket, which disappears with its process
_PARTICIPANTS = 32  # of a domain on one machine that find each other


class Domains:
    """Hands out ROS domains that nobody is in: no other test session, no other nodes."""

    def __init__(self) -> None:
        """Begin with TRUNK_TEST_DOMAIN; without it, with a number from the process id.

        Workers, whose ids follow one another, begin far apart: a node that a test has left holds its name in
        the domain until it is collected.
        """
        self._next = int(os.environ.get("TRUNK_TEST_DOMAIN", 29 * os.getpid()))
        self._lock = socket.socket(socket.AF_UNIX)

    def choose(self) -> int:
        """Return the next free domain, and give back the one before."""
        self._lock.close()
        for _ in range(_DOMAINS):
            domain = 1 + (self._next - 1) % _DOMAINS
            self._next += 1
            self._lock = socket.socket(socket.AF_UNIX)
            with suppress(OSError):
                self._lock.bind("\0" + _LOCK.format(domain))
                _check_deserted(domain)
                return domain
            self._lock.close()
        pytest.fail("every ROS domain from 1 to 100 is in use")

    def close(self) -> None:
        self._lock.close()


def _check_deserted(domain: int) -> None:
    """Raise OSError if a participant of this domain is alive, such as a node that some test leaked.

    Each holds one of the domain's ports for discovery, not always the first: others may have ended.
    """
    for participant in range(_PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            port.bind(("", _DDS_PORT + _PORTS_PER_DOMAIN * domain + 2 * participant))


@pytest.fixture(scope="session")
def domains() -> Iterator[Domains]:
    middleware.prepare()  # Fast DDS reads its settings once, for the first participant of this process
    chosen = Domains()
    yield chosen
    chosen.close()
    forked.end()


@pytest.fixture(autouse=True)
def domain(domains: Domains, monkeypatch: pytest.MonkeyPatch) -> int:
    """Put this test, and all that it starts, into its own domain."""
    number = domains.choose()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("RCUTILS_COLORIZED_OUTPUT", "0")
    return number


@pytest.fixture
def children(tmp_path: Path, domain: int, request: pytest.FixtureRequest) -> Iterator[Children]:
    started = Children(tmp_path)
    yield started
    started.close(request.node.stash.get(FAILED, False))


@pytest.fixture
def peer(domain: int) -> Iterator[Peer]:
    listener = Peer()
    yield listener
    listener.close()


@pytest.fixture
def arguments(domain: int) -> Iterator[Callable[..., None]]:
    """Yield a function that starts ROS 2 in this process, with parameters for the nodes that it makes."""

    def begin(*parameters: str) -> None:
        given = [word for parameter in parameters for word in ("-p", parameter)]
        rclpy.init(
            args=["--ros-args", "--log-level", "fatal", *given],
            signal_handler_options=SignalHandlerOptions.NO,
        )

    yield begin
    rclpy.try_shutdown()
    # A node with replaced methods is a reference cycle: until it is collected, others see it in the graph.
    gc.collect()


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nodes that end wait for a recorder longer than any busy machine holds it up.

    For tests whose recorder is the last to end: without one, a node would wait for minutes.
    """
    monkeypatch.setenv("TRUNK_PATIENCE", "200")
