"""Hosts on a network: network namespaces of this machine, each on its own link to one switch."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ..finished import finished
from ..graph.processes import Children

_PREFIX = f"trunk-test-{os.getpid()}"
_SWITCH = f"{_PREFIX}-switch"
_INTERFACE = "eth0"


def ip(*arguments: object) -> str:
    """Run iproute2's ``ip`` and return what it says; a failure raises CalledProcessError."""
    command = ["ip", *(str(part) for part in arguments)]
    return finished(command, check=True).stdout


def why_not() -> str | None:
    """Return why this machine lets us make no network namespaces, None where it does."""
    if shutil.which("ip") is None:
        return "network namespaces: there is no `ip` (iproute2)"
    if os.geteuid() != 0:
        return "network namespaces: only root may make them"
    try:
        ip("netns", "add", _SWITCH)
    except subprocess.CalledProcessError as error:
        return f"network namespaces: {error.stderr.strip()}"
    ip("netns", "del", _SWITCH)
    return None


class Host:
    """A network namespace with a loopback and one interface, whose far end is a port of the switch."""

    def __init__(self, name: str, address: str, folder: Path) -> None:
        self.address = address
        self._namespace = f"{_PREFIX}-{name}"
        self._port = f"port-{name}"
        folder.mkdir()
        self.children = Children(folder, through=("ip", "netns", "exec", self._namespace))

    def open(self) -> None:
        ip("netns", "add", self._namespace)
        inside = ("-n", self._namespace)
        far_end = ("peer", "name", self._port, "netns", _SWITCH)
        ip(*inside, "link", "add", _INTERFACE, "type", "veth", *far_end)
        self.plug_in()
        ip("-n", _SWITCH, "link", "set", self._port, "up")
        ip(*inside, "address", "add", f"{self.address}/24", "dev", _INTERFACE)
        for interface in ("lo", _INTERFACE):
            ip(*inside, "link", "set", interface, "up")

    def unplug(self) -> None:
        """Let the switch drop all frames: the host's interface stays up and notices nothing."""
        ip("-n", _SWITCH, "link", "set", self._port, "nomaster")

    def plug_in(self) -> None:
        ip("-n", _SWITCH, "link", "set", self._port, "master", "switch")

    def without_multicast(self) -> None:
        """Let the switch send no multicast to this host, as many networks do."""
        ip("-n", _SWITCH, "link", "set", self._port, "type", "bridge_slave", "mcast_flood", "off")

    def interface_down(self) -> None:
        """Take the interface down: it has no carrier, and the host no route, until it is up."""
        ip("-n", self._namespace, "link", "set", _INTERFACE, "down")

    def interface_up(self) -> None:
        ip("-n", self._namespace, "link", "set", _INTERFACE, "up")

    def lose(self, share: float) -> None:
        """Lose this share of the packets in each direction; 0: none."""
        inside = ("ip", "netns", "exec", self._namespace, "iptables", "--wait")
        for chain, direction in (("INPUT", "-i"), ("OUTPUT", "-o")):
            rules = [("-F", chain)]
            if share:
                odds = ("-m", "statistic", "--mode", "random", "--probability", share)
                rules += [("-A", chain, direction, _INTERFACE, *odds, "-j", "DROP")]
            for rule in rules:
                subprocess.run([*inside, *map(str, rule)], check=True, capture_output=True)

    def packets(self) -> int:
        """Return how many packets have come in over the link."""
        (link,) = json.loads(ip("-n", self._namespace, "-j", "-s", "link", "show", _INTERFACE))
        return int(link["stats64"]["rx"]["packets"])


@contextmanager
def network(
    folder: Path, failed: Callable[[], bool], number: int = 2
) -> Iterator[tuple[Host, ...]]:
    """Make a number of hosts on one switch, and remove them, their processes first."""
    hosts = tuple(Host(f"h{n}", f"10.0.0.{n}", folder / f"h{n}") for n in range(1, number + 1))
    try:
        ip("netns", "add", _SWITCH)
        bridge = ("switch", "type", "bridge", "mcast_snooping", 0)
        ip("-n", _SWITCH, "link", "add", *bridge)
        ip("-n", _SWITCH, "link", "set", "switch", "up")
        for host in hosts:
            host.open()
        yield hosts
    finally:
        try:
            for host in hosts:
                host.children.close(failed())
        finally:
            for line in ip("netns", "list").splitlines():
                if line.startswith(f"{_PREFIX}-"):
                    ip("netns", "del", line.split()[0])
