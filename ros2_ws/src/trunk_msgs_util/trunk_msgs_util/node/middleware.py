"""Middleware settings for a run, and a check that there is room for it; a user's own settings are kept."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import TrunkError
from . import settings

PROFILES = Path(__file__).with_name("fastdds.xml")
PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
SUPER_CLIENT = "ROS_SUPER_CLIENT"  # heeded with a discovery server alone
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_SHARED_MEMORY = Path("/dev/shm")
# ROS 2's tracing library needs two pages there. Without room for them, loading it kills the process with
# SIGBUS.
_TRACING = ("lttng-ust-wait-*", 2)
_PAGE = os.sysconf("SC_PAGE_SIZE")


class MiddlewareError(TrunkError):
    """The middleware cannot work here: what it lacks, and what to do."""


def prepare(shared_memory: Path = _SHARED_MEMORY) -> None:
    """Point Fast DDS to our profiles, unless the user has settings; call it before rclpy is initialised.

    Processes started one after the other then discover each other sooner, heartbeats are more frequent (the
    next one repairs what was sent to a half-discovered reader, and a node that ends waits for one), and
    messages go by UDP within a host too: shared memory can make a node deaf (fastdds.xml).
    A discovery server is asked for all that it knows: the recorder follows nodes of anybody's, on topics on
    which it has no endpoint itself. No node needs this to meet the others of its run.

    Raises MiddlewareError if loading ROS 2 would kill the process, and SettingError if a setting of the
    environment cannot be used.
    """
    settings.check()
    os.environ.setdefault(SUPER_CLIENT, "TRUE")
    if TRANSPORTS not in os.environ:  # with shared memory alone, nobody could reach us by UDP
        os.environ.setdefault(PROFILES_FILE, str(PROFILES))
    try:
        found = os.statvfs(shared_memory)
    except OSError:
        return  # no shared memory here
    free = found.f_bavail * found.f_frsize
    if free < _PAGE * _tracing_pages(shared_memory):
        raise MiddlewareError(
            f"{shared_memory} is full ({free} bytes free): no ROS 2 process can start; free some of it "
            f"(after a crash: rm {shared_memory}/fastrtps_*), or make it larger (docker run --shm-size)"
        )


def _tracing_pages(shared_memory: Path) -> int:
    """Return how many pages ROS 2's tracing still lacks: its files outlive the processes."""
    pattern, pages = _TRACING
    there = sum(path.stat().st_blocks > 0 for path in shared_memory.glob(pattern))
    return max(pages - there, 0)
