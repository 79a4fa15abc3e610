"""The guardian: a small process that stops a run's processes if the runner dies without doing so.

The kernel tells each process when the runner dies (see `node_processes`), but one that hangs does not hear
it. The guardian waits for the end of a socket of which the runner holds the other side. Over it come handles
to the processes (pidfds): unlike an id, a handle never comes to mean another process.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import struct
import subprocess
import sys
from contextlib import suppress

from trunk_msgs_util.node import early_signals

from .node_processes import stop

_FIRST, _LAST = b"f", b"l"
# Nothing is imported from the working directory, nor from this module's own.
_PROGRAM = f"import sys; sys.path[:] = filter(None, sys.path); import {__name__} as g; g.main()"


class Guardian:
    """The runner's side: names the processes to be stopped; a context manager that ends the guardian."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # the runner handles Ctrl-C
                preexec_fn=early_signals.block,  # noqa: PLW1509
            )

    def watch_me(self, last: bool) -> None:
        """Have the calling process stopped if the runner dies, the ``last`` ones after all others.

        A child registers itself before it becomes a node's program: a runner may die at any instant.
        """
        with suppress(OSError):  # no pidfd on this kernel, or the guardian was killed
            handle = os.pidfd_open(os.getpid())
            try:
                rights = (socket.SOL_SOCKET, socket.SCM_RIGHTS, struct.pack("i", handle))
                turn = _LAST if last else _FIRST
                self._socket.sendmsg([turn], [rights], socket.MSG_NOSIGNAL)
            finally:
                os.close(handle)

    def close(self) -> None:
        """End the guardian: every process has been stopped."""
        self._process.kill()
        self._process.wait()
        self._socket.close()

    def __enter__(self) -> Guardian:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Watched:
    """A process that is known by a pidfd."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        with open(f"/proc/self/fdinfo/{handle}", encoding="ascii") as file:  # noqa: PTH123
            fields = dict(line.split(":", 1) for line in file)
        self.pid = int(fields["Pid"])

    @property
    def ended(self) -> bool:
        return bool(select.select([self._handle], [], [], 0.0)[0])

    def signal(self, number: int) -> None:
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._handle, number)


def main() -> None:
    """Take in processes until the runner closes the socket or dies; then stop those that are left."""
    watched: dict[bytes, list[_Watched]] = {_FIRST: [], _LAST: []}
    with socket.socket(fileno=int(sys.argv[1])) as runner:
        while True:
            turn, handles, _, _ = socket.recv_fds(runner, 1, 1)
            if not turn:
                break
            watched[turn] += map(_Watched, handles)
    stop(watched[_FIRST], watched[_LAST])
