"""`CpuDeadline`: how long processes have been waited for, not counting time when a busy machine held them up.

A limit in wall time may report a hang when a process is only waiting for a processor that others use.
Linux shows the difference: for each thread, `/proc/PID/task/TID/schedstat` has the time on a processor and
the time spent waiting for one, both in ns. A process that hangs or is stopped waits for none.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from .units import nanoseconds

# A longer gap between two looks means that the observer itself was held up.
_GAP_NS = 200_000_000
# Below this fraction of the limit nothing is read: a quick answer costs nothing.
READ_FROM = 1 / 3
# R: running or ready to run; D: waiting for a disk, or for memory to be paged in.
_HELD_UP_STATES = frozenset("RD")


class Thread(NamedTuple):
    """What Linux reports about one thread."""

    run_ns: int  # time on a processor
    delay_ns: int  # time ready to run, but without one
    state: str  # R: running or ready, S: sleeping, D: waiting for a disk, T: stopped; empty: the observer


Threads = Mapping[int, Thread]


def threads_of(pid: int) -> Threads:
    """Return a process's threads by their id; none if it has ended or Linux does not report them."""
    threads: dict[int, Thread] = {}
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            run, delay, _ = (task / "schedstat").read_text("ascii").split()
            state = (task / "stat").read_text("ascii", "replace").rpartition(") ")[2][:1]
            tid = int(task.name)
            # The observing thread is running now: that says nothing about the time before.
            state = "" if tid == threading.get_native_id() else state
            threads[tid] = Thread(int(run), int(delay), state)
    except (OSError, ValueError):  # a thread has just ended, or there is no schedstat: as wall time
        pass
    return threads


def scheduling_delay_ns(before: Threads, now: Threads, wall_ns: int) -> int:
    """Return how much of ``wall_ns`` between two looks a process could not run although it was ready to.

    Its threads wait in parallel: the one that was held up longest counts. Linux adds the delay only when
    the wait is over, so a thread that is ready and has not run is judged by its state.
    """
    longest = 0
    for tid, thread in now.items():
        if (earlier := before.get(tid)) is None:
            continue
        held = thread.delay_ns - earlier.delay_ns
        if thread.state in _HELD_UP_STATES:
            held = max(held, wall_ns - (thread.run_ns - earlier.run_ns))
        longest = max(longest, held)
    return min(longest, wall_ns)


class SchedulingDelay:
    """Tells how long the processes waited for were held up between two looks."""

    def __init__(self, look: Callable[[int], Threads] = threads_of) -> None:
        self._look = look
        self._seen: dict[int, Threads] = {}

    def between(self, pids: Iterable[int], wall_ns: int) -> int:
        """Return how much of ``wall_ns``, the time since the last look, does not count.

        Time in which the processes wait for a processor one after the other adds up.
        """
        held_ns = max(wall_ns - _GAP_NS, 0)
        for pid in pids:
            threads = self._look(pid)
            held_ns += scheduling_delay_ns(self._seen.get(pid, {}), threads, wall_ns)
            self._seen[pid] = threads
        return min(held_ns, wall_ns)


class CpuDeadline:
    """Counts the time for which processes are waited for, up to a limit in s.

    Time on a processor counts: a process in an endless loop is given up like one that sleeps.
    """

    def __init__(
        self,
        limit_s: float,
        clock: Callable[[], float] = time.monotonic,
        look: Callable[[int], Threads] = threads_of,
    ) -> None:
        self._limit_ns = nanoseconds(limit_s)
        self._clock = clock
        self._held_up = SchedulingDelay(look)
        self.restart()

    def restart(self) -> None:
        """Start again from zero: there was a sign of life."""
        self._waited_ns = 0
        self._looked_ns = nanoseconds(self._clock())

    def spent(self, pids: Iterable[int]) -> bool:
        """Look at the processes waited for, and return True once the limit has been passed."""
        now_ns = nanoseconds(self._clock())
        wall_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        soon = self._waited_ns < self._limit_ns * READ_FROM
        self._waited_ns += wall_ns - self._held_up.between(() if soon else pids, wall_ns)
        return self._waited_ns > self._limit_ns
