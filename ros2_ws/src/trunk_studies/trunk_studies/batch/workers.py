"""Worker processes on this machine: they end with their parent, and get work as they need it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from itertools import islice
from multiprocessing import connection, get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

from trunk_core.errors import show_warnings_plainly
from trunk_msgs_util.node import early_signals

Item = TypeVar("Item")
Result = TypeVar("Result")

IN_FLIGHT = 3  # tasks per process: one running, the others ready to follow


def cores() -> int:
    """Return how many cores this process may use: fewer than the machine has in a container, for one."""
    return len(os.sched_getaffinity(0))


def worker_pool(count: int) -> Executor:
    """Return a pool whose processes end with this one, even when it is killed."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # per worker: there is one worker per core
    return _Pool(count, mp_context=get_context("spawn"), initializer=_end_with_parent)


def as_completed_bounded(
    pool: Executor, function: Callable[[Item], Result], items: Iterable[Item], limit: int
) -> Iterator[Result]:
    """Yield ``function`` of each item, in order of completion.

    At most ``limit`` items are in the pool at a time: more are added as results arrive. Raises what the
    function raises, and BrokenProcessPool if a process died. The pool is shut down at the end.
    """
    waiting: set[Future[Result]] = set()
    items = iter(items)
    try:
        while True:
            for item in islice(items, limit - len(waiting)):
                waiting.add(pool.submit(function, item))
            if not waiting:
                return
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class _Pool(ProcessPoolExecutor):
    """Leave Ctrl-C to the parent: a worker hit while importing would print a traceback."""

    def submit(self, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit; a worker started by this begins with the signals blocked."""
        with early_signals.held():
            return super().submit(*arguments, **named)


def _end_with_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    early_signals.unblock()
    show_warnings_plainly()
    parent = parent_process()
    if parent is None:
        return

    def watch(sentinel: int) -> None:
        connection.wait([sentinel])
        os._exit(1)

    Thread(target=watch, args=(parent.sentinel,), daemon=True).start()
