"""Blocks of a sweep as tasks of an existing Dask cluster. Needs the extra: requirements/cluster.txt."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

import pyarrow as pa

from ..errors import StudyError, SweepError
from .sweep import RunBlock, Runner, run_block

_CONNECT_S = 10.0
_IN_FLIGHT = 4  # blocks per thread of the cluster
_RETRIES = 3  # of a task whose worker was lost; the scheduler itself allows as many


def dask_runner(address: str) -> Runner:
    """Return a runner on the cluster whose scheduler listens at an address (tcp://HOST:PORT).

    A block whose worker dies is run again by another. Raises StudyError if Dask is not installed or
    the scheduler does not answer.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise StudyError(
            "--scheduler: dask.distributed is not installed; install it with: "
            "pip install -r requirements/cluster.txt"
        ) from None

    def run(blocks: Iterable[RunBlock]) -> Iterator[tuple[int, pa.Table]]:
        try:
            client: Any = Client(address, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise StudyError(f"--scheduler {address}: no scheduler answers: {reason}") from None
        with client:
            left = iter(blocks)
            numbers: dict[Any, int] = {}
            done = as_completed()

            def submit() -> None:
                """Keep every thread of the cluster busy, with no more blocks in memory than that needs."""
                most = _IN_FLIGHT * max(1, sum(client.nthreads().values()))
                for block in islice(left, max(0, most - len(numbers))):
                    task = client.submit(run_block, block, retries=_RETRIES, pure=False)
                    numbers[task] = block.index
                    done.add(task)

            submit()
            for future in done:
                index = numbers.pop(future)
                if future.status == "error":
                    raise SweepError(_lost(index, future.exception(), KilledWorker))
                yield index, future.result()
                submit()

    return run


def _lost(block: int, reason: Exception, killed: type[Exception]) -> str:
    if isinstance(reason, killed):
        return (
            f"block {block}: its workers died one after another; finished blocks are kept: "
            "run the same command again"
        )
    return f"block {block}: {type(reason).__name__}: {reason}"
