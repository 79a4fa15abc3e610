"""Processes that compute batches: they end with the one that started them."""

from __future__ import annotations

import os
import signal
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread
from typing import Any

from trunk_msgs_util.node import early_signals


def worker_pool(count: int) -> ProcessPoolExecutor:
    """Return a pool whose processes end with this one, even when it is killed."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # theirs: a process per core is enough
    return _Pool(count, mp_context=get_context("spawn"), initializer=_end_with_parent)


class _Pool(ProcessPoolExecutor):
    """Ctrl-C is this process's affair: a worker that it meets while importing would say so at length."""

    def submit(self, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit; a worker that this starts begins with the signals held back."""
        with early_signals.held():
            return super().submit(*arguments, **named)


def _end_with_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    early_signals.unblock()
    parent = parent_process()
    if parent is None:
        return

    def watch(sentinel: int) -> None:
        wait([sentinel])
        os._exit(1)

    Thread(target=watch, args=(parent.sentinel,), daemon=True).start()
