"""One run in a ROS domain at a time: a second one is refused before it starts a node.

Nodes also notice another node of their name, but only once DDS has found it. By then a second run's
controller may have commanded the first run's plant.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ..errors import RunError

_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid: unix(7), SO_PEERCRED


@contextmanager
def claimed_domain() -> Iterator[None]:
    """Hold this machine's ROS domain, which ``ROS_DOMAIN_ID`` names, for one run.

    An abstract socket of Linux is the token: it leaves no file, is free again as soon as its process is gone,
    and is seen where DDS on this machine is seen, in one network namespace. Raises RunError naming
    the process that holds it.
    """
    domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)
    name = f"\0trunk run, ROS domain {domain}"
    with socket.socket(socket.AF_UNIX) as token:
        try:
            token.bind(name)
            token.listen()
        except OSError as error:
            raise RunError(
                f"another run is under way in ROS domain {domain}{_holder(name)}: stop it or wait for its "
                "end, or set ROS_DOMAIN_ID to another number"
            ) from error
        yield


def _holder(name: str) -> str:
    with suppress(OSError), socket.socket(socket.AF_UNIX) as asked:
        asked.setblocking(False)  # its process need not answer
        asked.connect(name)
        credentials = asked.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        return f", in process {_CREDENTIALS.unpack(credentials)[0]}"
    return ""
