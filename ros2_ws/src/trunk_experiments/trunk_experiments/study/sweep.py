"""A sweep: a study's runs in blocks, on all cores or a cluster; a killed one keeps its finished blocks.

Each block becomes a file of its own, written under another name and renamed when whole; the last step
merges them in order. What a sweep writes depends on study and sources alone: not on workers, order,
time, or how often it was interrupted.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from threading import Thread
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from trunk_msgs_util.node import early_signals
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.provenance import gather
from trunk_msgs_util.recording.whole_file import whole_file

from ..analysis.metrics import Metrics, metrics
from ..batch.closed_loop import Batch, loops_fingerprint
from ..compiled import fingerprint
from ..runs.graph import RunError
from .design import Bases, design, make_bases, plan_of
from .study import Study, StudyError

METRICS = tuple(Metrics.__dataclass_fields__)
_PROGRAM = "sources"  # key of a block's metadata
Progress = Callable[[int], None]  # takes the number of finished runs


class SweepError(RunError):
    """A sweep that went wrong while it ran."""


@dataclass(frozen=True)
class RunBlock:
    """Some runs of a study, with all that it takes to make them: no file is read where they run."""

    index: int
    study: Study
    bases: Bases
    columns: dict[str, list[Any]]


Runner = Callable[[Iterable[RunBlock]], Iterator[tuple[int, pa.Table]]]


def sources() -> str:
    """Return a hash of the sources and of the libraries that decide a run's numbers."""
    libraries = {name: text for name, text in gather().items() if name in ("numpy", "libm")}
    return f"{loops_fingerprint()}-{fingerprint(metrics)}-{json.dumps(libraries, sort_keys=True)}"


@cache
def _batch() -> Batch:
    return Batch()


def run_block(block: RunBlock) -> pa.Table:
    """Return a block's rows with their results."""
    columns = dict(block.columns)
    results: list[dict[str, Any]] = []
    for values in zip(*columns.values(), strict=True):
        row = dict(zip(columns, values, strict=True))
        try:
            plan = plan_of(block.study, block.bases, row)
        except ParameterError as error:
            results.append({"status": "refused", "reason": str(error)})
            continue
        outcome = _batch().run(plan)
        found = outcome.metrics()
        if found is None:
            results.append({"status": "diverged", "diverged_at_s": outcome.diverged_at})
        else:
            results.append({"status": "ok", **found.as_dict()})
    arrays = {name: pa.array(values, _type(name, values)) for name, values in columns.items()}
    for name in ("status", "reason"):
        arrays[name] = pa.array([result.get(name) for result in results], pa.string())
    for name in ("diverged_at_s", *METRICS):
        arrays[name] = pa.array([result.get(name) for result in results], pa.float64())
    return pa.table(arrays).replace_schema_metadata({_PROGRAM: sources()})


_TYPES = {"run": pa.int64(), "point": pa.int64(), "draw": pa.int64(), "seed": pa.int64()}


def _type(name: str, values: list[Any]) -> pa.DataType:
    if name in _TYPES:
        return _TYPES[name]
    if isinstance(values[0], bool):
        return pa.bool_()
    return pa.string() if isinstance(values[0], str) else pa.float64()


class Sweep:
    """A study on its way into a Parquet file."""

    def __init__(self, study: Study, output: Path) -> None:
        self.study = study
        self.output = output
        self.folder = output.with_name(output.name + ".blocks")
        self.blocks = -(-study.total // study.block)
        self._key = {"study": study.content, "sources": sources()}

    def check(self) -> None:
        """Raise StudyError for a study that cannot be."""
        self.bases = make_bases(self.study)

    def start(self) -> int:
        """Make ready and return the number of runs that an earlier, interrupted sweep has finished.

        Raises StudyError for a study that cannot be, or where the finished blocks are another study's.
        """
        self.check()
        mark = self.folder / "sweep.json"
        self.folder.mkdir(parents=True, exist_ok=True)
        if mark.exists():
            if json.loads(mark.read_text(encoding="utf-8")) != self._key:
                raise StudyError(
                    f"{self.folder}: finished blocks of another study or other sources: "
                    "delete the folder, or give another -o"
                )
        else:
            with whole_file(mark) as part:
                part.write_text(json.dumps(self._key))
        self.missing = [i for i in range(self.blocks) if not self._path(i).exists()]
        return self.study.total - sum(len(self._rows(i)) for i in self.missing)

    @property
    def warnings(self) -> list[str]:
        """What the plans of the study warn of, each once."""
        told = {text: None for base in self.bases.values() for text in base.plan.warnings}
        return list(told)

    def run(self, runner: Runner, progress: Progress = lambda runs: None) -> None:
        """Run what is missing and write each block as it comes. Raises SweepError."""
        jobs = (
            RunBlock(i, self.study, self.bases, design(self.study, rows.start, rows.stop))
            for i in self.missing
            for rows in [self._rows(i)]
        )
        for index, table in runner(jobs):
            if (table.schema.metadata or {}).get(_PROGRAM.encode()) != sources().encode():
                raise SweepError(
                    f"block {index} comes from a worker with other sources or libraries: "
                    "install the same on all"
                )
            with whole_file(self._path(index)) as part:
                pq.write_table(table, part)
            progress(len(table))

    def finish(self) -> None:
        """Merge the blocks into the output and delete them."""
        told = gather(scenario=self.study.scenario)
        told.pop("started_utc")  # the same study gives the same file
        metadata = {
            "study": self.study.text,
            "study_content": self.study.content,
            "sources": self._key["sources"],
            "provenance": json.dumps(told),
            "grid": json.dumps([v.name for v in self.study.grid]),
            "variables": json.dumps([v.name for v in self.study.variables]),
        }

        schema = pq.read_schema(self._path(0)).with_metadata(metadata)
        with (
            whole_file(self.output) as part,
            pq.ParquetWriter(part, schema, compression="zstd") as writer,
        ):
            for i in range(self.blocks):
                writer.write_table(pq.read_table(self._path(i)).cast(schema))
        shutil.rmtree(self.folder)

    def _rows(self, index: int) -> range:
        first = index * self.study.block
        return range(first, min(first + self.study.block, self.study.total))

    def _path(self, index: int) -> Path:
        return self.folder / f"{index:08d}.parquet"


def processes(count: int) -> Runner:
    """Return a runner on so many processes of this machine; 1 stays in this process."""

    def run(blocks: Iterable[RunBlock]) -> Iterator[tuple[int, pa.Table]]:
        if count == 1:
            for block in blocks:
                yield block.index, run_block(block)
            return
        with worker_pool(count) as pool:
            waiting = {pool.submit(run_block, block): block.index for block in blocks}
            try:
                for future in as_completed(waiting):
                    yield waiting[future], future.result()
            except BrokenProcessPool:
                raise SweepError(
                    "a worker process was killed (out of memory?); finished blocks are kept: "
                    "run the same command again"
                ) from None
            finally:
                pool.shutdown(wait=False, cancel_futures=True)

    return run


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


def outcome_counts(path: Path) -> dict[str, int]:
    """Return how many runs of a result ended in which status."""
    statuses = pq.read_table(path, columns=["status"]).column("status").to_pylist()
    return {name: statuses.count(name) for name in ("ok", "diverged", "refused")}
