"""A source: the text NODE@PROCESS that, in real time, names who sent a message that is recorded.

It is the frame of a JointState message or an event, which mean nothing else there. Other projects' messages
have none. In lock-step there is one process for each node by construction, and no message names it.
PROCESS is unique on any host and at any time: its boot's id, its number and its start time.
"""

from __future__ import annotations

import errno
import os
import re
import socket
import struct
from contextlib import suppress
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path

from trunk_core.errors import TrunkError

# In ``plant/inputs``: of what an external node sent, or where nothing acts.
NO_SOURCE = "-"
# In ``plant/inputs``: of a command that answers no state by its stamp, and acts from its arrival.
ARRIVAL = "*"
# Under which names the simulator counts such commands.
NO_STAMP, CLOCK_STAMP, ODD_STAMP = ARRIVALS = (
    "commands without a stamp",
    "commands with a clock's stamp",
    "commands with no state's stamp",
)

# No blank, no second @; three of them are still a frame that every reader takes.
_SOURCE = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,239}@[!-?A-~]{0,98}")


def source(name: str, process: str) -> str:
    """Return the source of a node, by its own name and its process's identity."""
    return f"{name}@{process}"


@lru_cache(maxsize=256)
def source_in(frame_id: str) -> str:
    """Return the source that a message's frame gives; empty if it gives none."""
    return frame_id if _SOURCE.fullmatch(frame_id) else ""


def process_of(source: str) -> str:
    """Return the identity of a source's process; empty if the source or its process is not known."""
    return source.partition("@")[2]


@lru_cache(maxsize=256)
def frame_of_inputs(simulator: str, command: str, disturbance: str) -> str:
    """Return the frame of a row of ``plant/inputs``: the sources of the row itself and of what acts."""
    return " ".join(text or NO_SOURCE for text in (simulator, command, disturbance))


@lru_cache(maxsize=256)
def sources_of_inputs(frame_id: str) -> tuple[str, str, str] | None:
    """Return the three sources that a row's frame names, empty where there is none; None for any other."""
    texts = frame_id.split(" ")
    if len(texts) != 3 or not all(
        text == NO_SOURCE or source_in(text) or (place == 1 and text == ARRIVAL)
        for place, text in enumerate(texts)
    ):
        return None
    simulator, command, disturbance = ("" if text == NO_SOURCE else text for text in texts)
    return simulator, command, disturbance


_BOOT = Path("/proc/sys/kernel/random/boot_id")


def process_id(pid: int | None = None) -> str:
    """Return ``BOOT.PID.START``, of this process by default; empty where there is none.

    START counts the kernel's ticks since the boot; an exec does not change it.
    """
    pid = os.getpid() if pid is None else pid
    with suppress(OSError, IndexError):
        started = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rpartition(") ")[2]
        return f"{_BOOT.read_text('ascii').strip()}.{pid}.{started.split()[19]}"
    return ""


def same_machine(identity: str) -> bool:
    """Return True if a process ran, or runs, on this machine since it was booted."""
    with suppress(OSError):
        return identity.partition(".")[0] == _BOOT.read_text("ascii").strip()
    return False


def is_older(identity: str, other: str) -> bool | None:
    """Return True if a process was started before another one; None if they ran on different machines.

    Of two that were started within one tick of the kernel, the one with the smaller number counts as older.
    """
    (boot, *numbers), (other_boot, *other_numbers) = identity.split("."), other.split(".")
    if boot != other_boot:
        return None
    if not all(len(n) == 2 and all(map(str.isdecimal, n)) for n in (numbers, other_numbers)):
        return None
    ages = [(int(started), int(pid)) for pid, started in (numbers, other_numbers)]
    return ages[0] < ages[1]


def local_pid(identity: str) -> int | None:
    """Return the number of a process that runs on this machine and is visible from here; else None."""
    _, _, rest = identity.partition(".")
    number = rest.partition(".")[0]
    if number.isdecimal() and len(number) < 12 and process_id(int(number)) == identity:
        return int(number)
    return None


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
