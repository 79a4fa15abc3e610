"""Nodes of one name: the older one stays; the newcomer ends before it takes part, or as soon as it knows."""

from __future__ import annotations

import errno
import os
import socket
import struct
import time
from collections.abc import Mapping
from contextlib import suppress
from hashlib import blake2b
from typing import ClassVar

from rclpy.utilities import get_rmw_implementation_identifier

from ..errors import EXIT_FAILED, TrunkError
from ..events import Event
from ..source import is_older, local_pid, process_id, same_machine
from ..text import printable
from . import middleware
from .managed import ManagedNode

# Of two on different machines without a run, one that is configured for so long is not the newcomer;
# multiplied by TRUNK_PATIENCE.
_SETTLED_S = 3.0
# A node that the graph shows under one's own name says within this time who it is; one that was killed says
# nothing. Multiplied by TRUNK_PATIENCE.
_SPEAKS_S = 1.0


class DuplicateNodeError(TrunkError):
    """Another process of this machine has a node of this name."""

    exit_code: ClassVar[int] = EXIT_FAILED


class UniqueNode(ManagedNode):
    """A node whose name in its namespace and domain is its own: a recording would mix two."""

    def claim_name(self) -> None:
        """Hold the name against later processes of this machine. Raises DuplicateNodeError if one has it.

        Those are not told by events: what a newcomer publishes until it hears of the older node would
        already be in the run. Only processes that hear one another compete: of one domain and middleware.
        """
        name = self.get_fully_qualified_name()
        domain = self.context.get_domain_id()
        middleware = get_rmw_implementation_identifier()
        try:
            self._claim = claimed(f"node {middleware} {domain} {name}")
        except HeldError as error:
            self.destroy_node()
            raise DuplicateNodeError(_reason(name, str(error))) from None
        self._processes = {name: process_id()}  # of nodes by name: the oldest that is alive
        self._configured_s = time.monotonic()
        self._doubled_since_s: float | None = None
        self._duplicate_seen = False

    @property
    def leads_a_run(self) -> bool:
        """True while a run of this node's own is under way."""
        return False

    def release_name(self) -> None:
        """Let another process have the name."""
        self._claim.close()

    def event(self, message: Event, level: bytes = b"\0", **values: object) -> None:
        """Put an event in the run's record."""
        if message == Event.CONFIGURED:
            self._configured_s = time.monotonic()

    def fail(self, reason: str, **values: object) -> None:
        """End this node's process with an error."""

    def look_for_duplicate(self, node: str, message: str, values: Mapping[str, str]) -> None:
        """End this node if an event shows that an older one has its name.

        Of two on one machine the processes' identities tell which is older. Of others, the one whose run is
        under way stays, and so does one that has been configured for a while.
        """
        process = values.get("process", "")
        if (
            message != Event.CONFIGURED
            or node != self.get_fully_qualified_name()
            or process in ("", process_id())
            or self.exit_code is not None
            or not self._is_alive(node, process)
        ):
            return
        self._duplicate_seen = True
        first = is_older(process_id(), process)
        if first is None:
            waited = time.monotonic() - self._configured_s
            first = self.leads_a_run or waited > _SETTLED_S * middleware.patience()
        if first:
            self.get_logger().warning(
                f"a second {node} was started, in process {printable(process)}: it ends by itself"
            )
        elif self.leads_a_run:
            self.fail(_reason(node, process))
        else:  # without an event: the older node's recording would take it for that node's
            self.get_logger().error(printable(_reason(node, process)))
            self.exit_code = EXIT_FAILED

    def may_be_second(self) -> bool:
        """Return True, for a bounded time, while the graph shows another node of this name that is silent."""
        if self._duplicate_seen or not self._is_doubled(self.get_fully_qualified_name()):
            self._doubled_since_s = None
            return False
        if self._doubled_since_s is None:
            self._doubled_since_s = time.monotonic()
        return time.monotonic() - self._doubled_since_s < _SPEAKS_S * middleware.patience()

    def is_second(self, node: str, process: str) -> bool:
        """Return True for the process of a node whose name an older process that is alive has: it ends.

        A node is not a second one if its process is not known.
        """
        first = self._processes.get(node, "")
        if not process or process == first:
            return False
        if first and not is_older(process, first) and self._is_alive(node, first):
            return True
        self._processes[node] = process
        return False

    def _is_alive(self, node: str, process: str) -> bool:
        """Return True for a node's process, and False if an old recording is being played.

        A process on another machine cannot be looked up: there the graph must show two nodes of the name.
        """
        if same_machine(process):
            return local_pid(process) is not None
        return self._is_doubled(node)

    def _is_doubled(self, node: str) -> bool:
        """Return True if the graph shows more than one node of a name."""
        namespace, _, name = node.rpartition("/")
        return self.get_node_names_and_namespaces().count((name, namespace or "/")) > 1


def _reason(node: str, process: str) -> str:
    return (
        f"another {node} is running, in process {process or 'unknown'}: stop it, or give each its own "
        "namespace or ROS_DOMAIN_ID"
    )


_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid: unix(7), SO_PEERCRED


class HeldError(TrunkError):
    """Another process holds the name; the text is its number, or empty."""


def claimed(name: str) -> socket.socket:
    """Hold a name until the socket is closed or the process ends, however it ends. Raises HeldError.

    An abstract socket of Linux is the token: it leaves no file, and is seen where DDS on this machine is
    seen, in one network namespace. The process that holds the name may claim it again.
    """
    token = socket.socket(socket.AF_UNIX)
    address = f"\0trunk {blake2b(name.encode(), digest_size=16).hexdigest()}"
    try:
        token.bind(address)
        token.listen()
    except OSError as error:
        holder = _holder(address)
        if error.errno == errno.EADDRINUSE and holder != str(os.getpid()):
            token.close()
            raise HeldError(holder) from None
    return token


def _holder(address: str) -> str:
    with suppress(OSError), socket.socket(socket.AF_UNIX) as asked:
        asked.setblocking(False)  # its process need not answer
        asked.connect(address)
        credentials = asked.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        return str(_CREDENTIALS.unpack(credentials)[0])
    return ""
