"""`Patience`: how long processes have been waited for, without the time in which a busy machine held them up.

A limit in wall time says that a process hangs when it may only be waiting for a processor that others use.
Linux tells the difference: for each thread, `/proc/PID/task/TID/schedstat` has the time on a processor and
the time spent waiting for one, both in ns. A process that hangs or is stopped waits for none.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from .units import NANOSECONDS, seconds

# A longer gap between two looks means that the observer itself was held up.
_GAP_S = 0.2
# Below this part of the limit nothing is read: whoever answers soon costs nothing.
_READ_FROM = 1 / 3
# Ready to run (or running), and waiting for a disk or for memory to come back from it.
_HELD_UP_STATES = frozenset("RD")


class Thread(NamedTuple):
    """What Linux tells of one thread."""

    run_ns: int  # time on a processor
    delay_ns: int  # time ready to run, but without one
    state: str  # R: running or ready, S: sleeping, D: waiting for a disk, T: stopped


Threads = Mapping[int, Thread]


def threads_of(pid: int) -> Threads:
    """Return a process's threads by their id; none where it has ended or Linux does not tell."""
    found: dict[int, Thread] = {}
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            run, delay, _ = (task / "schedstat").read_text("ascii").split()
            state = (task / "stat").read_text("ascii", "replace").rpartition(") ")[2][:1]
            found[int(task.name)] = Thread(int(run), int(delay), state)
    except (OSError, ValueError):  # a thread has just ended, or there is no schedstat: as wall time
        pass
    return found


def held_up_ns(before: Threads, now: Threads, wall_ns: int) -> int:
    """Return how much of ``wall_ns`` between two looks a process could not run although it was ready to.

    Its threads wait side by side: the one that was held up longest counts. The delay is only booked when
    the wait is over, so that a thread that is ready and has not run counts by its state.
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


class Patience:
    """Counts the time for which processes are waited for, up to a limit in s.

    Time on a processor counts: a process in an endless loop is given up like one that sleeps.
    """

    def __init__(
        self,
        limit_s: float,
        clock: Callable[[], float] = time.monotonic,
        look: Callable[[int], Threads] = threads_of,
    ) -> None:
        self.limit_s = limit_s
        self._clock, self._look = clock, look
        self._seen: dict[int, Threads] = {}
        self.restart()

    def restart(self) -> None:
        """Begin anew: there was a sign of life."""
        self.waited_s = 0.0
        self._looked_s = self._clock()
        self._seen.clear()

    def spent(self, pids: Iterable[int]) -> bool:
        """Look at the processes waited for, and return True once the limit has been passed.

        Time in which they wait for a processor one after the other adds up.
        """
        now_s = self._clock()
        wall_s = min(now_s - self._looked_s, _GAP_S)
        self._looked_s = now_s
        held_s = 0.0
        if self.waited_s >= self.limit_s * _READ_FROM:
            wall_ns = round(wall_s * NANOSECONDS)
            for pid in pids:
                threads = self._look(pid)
                held_s += seconds(held_up_ns(self._seen.get(pid, {}), threads, wall_ns))
                self._seen[pid] = threads
        self.waited_s += max(wall_s - held_s, 0.0)
        return self.waited_s > self.limit_s
