"""Tell processes to end, and kill those that do not: in less than the 10 s of docs/faults.md."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from trunk_msgs_util.cpu_deadline import CpuDeadline

# A node that ends hands its evidence over within 3 s.
FIRST_S = 3.7
# For all: the recorder, too, needs up to 4 s. A death is noticed, and its reason read, within 0.6 s.
ALL_S = 8.0
_POLL_S = 0.02


class Stoppable(Protocol):
    """A process, as far as it is to be stopped."""

    @property
    def pid(self) -> int:
        """Its id, while it has not been waited for."""

    @property
    def ended(self) -> bool:
        """True once it has ended."""

    def signal(self, number: int) -> None:
        """Send a signal where the process still runs."""


Process = TypeVar("Process", bound=Stoppable)


def stop(
    first: Sequence[Process],
    last: Sequence[Process],
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> list[Process]:
    """Tell all of ``first`` to end, and ``last`` when they have; kill those that do not.

    ``last`` is the recorder: it has to record the others' last messages. Return those that had to be killed;
    none is left running.
    """
    total = CpuDeadline(ALL_S, clock)
    killed = _end(first, [CpuDeadline(FIRST_S, clock), total], sleep)
    return killed + _end(last, [total], sleep)


def _end(
    processes: Sequence[Process], limits: Sequence[CpuDeadline], sleep: Callable[[float], None]
) -> list[Process]:
    for process in processes:
        process.signal(signal.SIGINT)
    while hung := _left(processes):
        pids = [process.pid for process in hung]
        spent = [limit.spent(pids) for limit in limits]
        if any(spent):
            break
        sleep(_POLL_S)
    for process in hung:
        process.signal(signal.SIGKILL)
    while _left(hung):
        sleep(_POLL_S)
    return hung


def _left(processes: Sequence[Process]) -> list[Process]:
    return [process for process in processes if not process.ended]
