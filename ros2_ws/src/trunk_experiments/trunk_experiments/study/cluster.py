"""Blocks of a sweep as tasks of an existing Dask cluster. Needs the extra: requirements/cluster.txt."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import pyarrow as pa

from .study import StudyError
from .sweep import RunBlock, Runner, SweepError, run_block

_CONNECT_S = 10.0
_RETRIES = 3  # of a task whose worker was lost; the scheduler itself allows as many losses


def dask_runner(address: str) -> Runner:
    """Return a runner on the cluster whose scheduler listens at an address (tcp://HOST:PORT).

    A block whose worker dies is run again by another. Raises StudyError where Dask is not installed or
    the scheduler does not answer.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise StudyError(
            "--scheduler: dask.distributed is not installed; it comes with: "
            "pip install -r requirements/cluster.txt"
        ) from None

    def run(blocks: Iterable[RunBlock]) -> Iterator[tuple[int, pa.Table]]:
        try:
            client: Any = Client(address, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise StudyError(f"--scheduler {address}: no scheduler answers: {reason}") from None
        with client:
            tasks = {
                client.submit(run_block, block, retries=_RETRIES, pure=False): block.index
                for block in blocks
            }
            done = as_completed(list(tasks))
            for future in done:
                if future.status == "error":
                    raise SweepError(_lost(tasks[future], future.exception(), KilledWorker))
                yield tasks[future], future.result()

    return run


def _lost(block: int, reason: Exception, killed: type[Exception]) -> str:
    if isinstance(reason, killed):
        return (
            f"block {block}: its workers died one after another; finished blocks are kept: "
            "run the same command again"
        )
    return f"block {block}: {type(reason).__name__}: {reason}"
