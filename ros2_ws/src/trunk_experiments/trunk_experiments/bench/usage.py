"""Memory and processor time of running processes, from Linux's ``/proc``."""

from __future__ import annotations

import os
from pathlib import Path

_PROC = Path("/proc")
_TICKS_HZ = os.sysconf("SC_CLK_TCK")
# Fields of /proc/PID/stat, counted after the name in brackets: user and system time of all threads.
_UTIME, _STIME = 11, 12


def resident_bytes(pid: int) -> int:
    """Return the process's resident memory (RSS), shared pages included. Raises OSError."""
    for line in (_PROC / str(pid) / "smaps_rollup").read_text().splitlines():
        key, _, value = line.partition(":")
        if key == "Rss":
            return int(value.split()[0]) * 1024
    raise OSError(f"/proc/{pid}/smaps_rollup: no line Rss")


def processor_seconds(pid: int) -> float:
    """Return the processor time that all threads of the process have used. Raises OSError."""
    text = (_PROC / str(pid) / "stat").read_text()
    fields = text.rpartition(")")[2].split()
    return (int(fields[_UTIME]) + int(fields[_STIME])) / _TICKS_HZ
