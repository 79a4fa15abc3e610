"""A name that one process of this machine holds at a time."""

from __future__ import annotations

import errno
import os
import socket
import struct
from contextlib import suppress
from hashlib import blake2b

from ..errors import TrunkError

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
        told = asked.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        return str(_CREDENTIALS.unpack(told)[0])
    return ""
