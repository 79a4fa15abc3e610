"""Middleware settings that a run needs, and whether there is room for it; a user's own settings are kept."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ..errors import TrunkError
from . import settings

PROFILES = Path(__file__).with_name("fastdds.xml")
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_SHARED_MEMORY = Path("/dev/shm")
# Fast DDS 2.14, for each process that takes part: a segment of 540 KiB, two ports of 52 KiB, small files.
_PARTICIPANT = 664 << 10
# The library of ROS 2's tracing has two pages there. Without room for them it dies of SIGBUS as it is
# loaded, and the process with it.
_TRACING = ("lttng-ust-wait-*", 2)
_PAGE = os.sysconf("SC_PAGE_SIZE")


class MiddlewareError(TrunkError):
    """The middleware cannot work here: what it lacks, and what to do."""


def prepare(participants: int = 1, shared_memory: Path = _SHARED_MEMORY) -> None:
    """Point Fast DDS to our profiles unless others are set; call it before rclpy is initialised.

    Processes started one after the other then discover each other sooner, and heartbeats are more frequent:
    the next one repairs what was sent to a half-discovered reader, and a node that ends waits for one.

    Where shared memory has no room for so many ``participants``, Fast DDS is told to use UDP, and a line on
    stderr says so. Raises MiddlewareError where there is no room at all, and SettingError where a setting of
    the environment cannot be used.
    """
    settings.check()
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(PROFILES))
    try:
        found = os.statvfs(shared_memory)
    except OSError:
        return  # no shared memory here: Fast DDS uses none
    free = found.f_bavail * found.f_frsize
    if free < _PAGE * _tracing_pages(shared_memory):
        raise MiddlewareError(
            f"{shared_memory} is full ({free} bytes free): no ROS 2 process can start; free some of it "
            f"(after a crash: rm {shared_memory}/fastrtps_*), or make it larger (docker run --shm-size)"
        )
    needed = participants * _PARTICIPANT
    if free < needed and TRANSPORTS not in os.environ and _is_fast_dds():
        os.environ[TRANSPORTS] = "UDPv4"  # what this process starts inherits it
        print(
            f"{shared_memory} has {free >> 10} kB free, {needed >> 10} kB are needed: "
            "messages go by UDP instead of shared memory",
            file=sys.stderr,
            flush=True,
        )


def _tracing_pages(shared_memory: Path) -> int:
    """Return how many pages ROS 2's tracing still lacks: its files outlive the processes."""
    pattern, pages = _TRACING
    there = sum(path.stat().st_blocks > 0 for path in shared_memory.glob(pattern))
    return max(pages - there, 0)


def _is_fast_dds() -> bool:
    return "fastrtps" in os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
