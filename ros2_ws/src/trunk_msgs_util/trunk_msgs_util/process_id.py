"""A process's identity, unique on any host and at any time: its boot's id, its number and its start time."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

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


def is_older(one: str, other: str) -> bool | None:
    """Return True if a process was started before another one; None if they ran on different machines.

    Of two that were started within one tick of the kernel, the one with the smaller number counts as older.
    """
    (boot, *numbers), (other_boot, *other_numbers) = one.split("."), other.split(".")
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
