"""A sweep: a study's runs in blocks, on all cores or a cluster; a killed one keeps its finished blocks.

Each block becomes its own file, written under another name and renamed when complete; the last step
merges them in order. A sweep's output depends only on study and sources: not on workers, order,
time, or interruptions.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from platform import libc_ver, machine
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from trunk_control.laws import law_named
from trunk_core.compiled import fingerprint
from trunk_core.errors import StudyError, SweepError
from trunk_core.files import atomic_write
from trunk_evidence.run_metrics import Metrics
from trunk_recording.provenance import ARITHMETIC, OF_MACHINE, gather, packages_of_plugins
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.offline_recording import Progress

from .batch.block import Maker
from .batch.kernel import OnDevice, kernel_of, templates
from .batch.workers import IN_FLIGHT, as_completed_bounded, worker_pool
from .rows import AT_ONCE, Bases, difference, digest, identity, make_bases, outcomes, plans_json
from .study import StudySpec, design

METRICS = tuple(Metrics.__dataclass_fields__)
_PROGRAM, _CONTENT = "sources", "study_content"  # keys of a block's metadata
_CONNECT_S = 10.0  # to a Dask cluster
_IN_FLIGHT = 4  # blocks per thread of the cluster
_RETRIES = 3  # of a task whose worker was lost; the scheduler itself allows as many


@dataclass(frozen=True)
class RunBlock:
    """Some runs of a study with everything they need: a worker reads no files."""

    index: int
    study: StudySpec
    bases: Bases
    columns: dict[str, list[Any]]
    content: str  # the study's hash


Runner = Callable[[Iterable[RunBlock]], Iterator[tuple[int, pa.Table]]]


@cache
def sources() -> str:
    """Return a hash of the sources and of the libraries that determine a run's numbers."""
    libraries = {"numpy": version("numpy")}  # its generators and grids
    libraries |= {"arithmetic": ARITHMETIC, "libm": " ".join(libc_ver()), "machine": machine()}
    libraries |= packages_of_plugins()
    libraries["kernel"] = hashlib.sha256("".join(templates()).encode()).hexdigest()[:16]
    code = fingerprint(run_block, kernel_of, *(law_named(name).update for name in CONTROLLERS))
    return f"{code}-{json.dumps(libraries, sort_keys=True)}"


def run_block(block: RunBlock, maker: Maker | None = None) -> pa.Table:
    """Return a block's rows with their results; ``maker``: that of `outcomes`."""
    ended = outcomes(block.study, block.bases, block.columns, maker)
    arrays = {name: pa.array(values, _type(name, values)) for name, values in block.columns.items()}
    status = np.where(np.isnan(ended.diverged_at), "ok", "diverged").astype(object)
    status[list(ended.refused)] = "refused"
    arrays["status"] = pa.array(status, pa.string())
    arrays["reason"] = pa.array(map(ended.refused.get, range(len(status))), pa.string())
    arrays["fell"] = pa.array(ended.fell, pa.bool_(), mask=status == "refused")
    numbers = ended.diverged_at, *ended.metrics
    for name, values in zip(("diverged_at_s", *METRICS), numbers, strict=True):
        known = np.where(np.isinf(values), np.nan, values)  # a time of settling that is never
        arrays[name] = pa.array(known, pa.float64(), from_pandas=True)  # NaN: null
    return pa.table(arrays).replace_schema_metadata({_PROGRAM: sources(), _CONTENT: block.content})


_TYPES = {"run": pa.int64(), "point": pa.int64(), "draw": pa.int64(), "seed": pa.int64()}


def _type(name: str, values: list[Any]) -> pa.DataType:
    if name in _TYPES:
        return _TYPES[name]
    if isinstance(values[0], bool):
        return pa.bool_()
    return pa.string() if isinstance(values[0], str) else pa.float64()


class SweepJob:
    """A sweep of one study into one Parquet file."""

    bases: Bases

    def __init__(self, study: StudySpec, output: Path) -> None:
        self.study = study
        self.output = output
        self.folder = output.with_name(output.name + ".blocks")
        self.blocks = -(-study.total // study.block)
        self._mark = self.folder / "sweep.json"

    def check(self) -> None:
        """Resolve the plans and refuse what cannot be swept; nothing is written.

        Raises StudyError for a study that is not possible, or if finished blocks belong to another study.
        """
        if self.output.exists() and not self.output.is_file():
            raise StudyError(f"{self.output}: not a regular file: name a new .parquet file")
        self.bases = make_bases(self.study)
        self._identity = identity(self.study, self.bases)
        self._key = {_PROGRAM: sources(), _CONTENT: digest(self._identity)}
        if self.folder.exists() and not self.folder.is_dir():
            raise StudyError(f"{self.folder}: not a folder: move it, or give another -o")
        reason = self._foreign()
        if reason:
            raise StudyError(
                f"{self.folder}: its finished blocks {reason}: delete the folder, or give another -o"
            )

    def start(self) -> int:
        """Prepare the folder and return the number of runs that an earlier, interrupted sweep has finished.

        Raises StudyError as `check` does.
        """
        self.check()
        self.folder.mkdir(exist_ok=True)
        if not self._mark.exists():
            with atomic_write(self._mark) as part:
                part.write_text(json.dumps({_PROGRAM: sources(), "study": self._identity}))
        self.missing = [i for i in range(self.blocks) if not self._path(i).exists()]
        self._done = self.study.total - sum(len(self._rows(i)) for i in self.missing)
        return self._done

    def _foreign(self) -> str:
        """Return why the finished blocks are not this sweep's; empty if they are, or if there are none."""
        if not self._mark.exists():
            return "are of an unknown study" if any(self.folder.glob("*.parquet")) else ""
        try:
            mark = json.loads(self._mark.read_text(encoding="utf-8"))
            program, study = mark[_PROGRAM], mark["study"]
            reason = difference(study, self._identity)
        except (ValueError, TypeError, KeyError, AttributeError):
            return "are of an unknown study"
        return reason or ("were made by other sources or libraries" * (program != sources()))

    @property
    def warnings(self) -> list[str]:
        """The warnings of the study's plans, each once."""
        texts = {text: None for plan in self.bases.values() for text in plan.warnings}
        return list(texts)

    def waiting(self) -> Iterator[RunBlock]:
        """Yield the missing blocks, each created on demand."""
        for i in self.missing:
            rows = self._rows(i)
            columns = design(self.study, rows.start, rows.stop)
            yield RunBlock(i, self.study, self.bases, columns, self._key[_CONTENT])

    def run(self, runner: Runner, progress: Progress = lambda done, of: None) -> None:
        """Run what is missing and write each block as it comes. Raises SweepError."""
        for index, table in runner(self.waiting()):
            self.keep(index, table)
            self._done += len(table)
            progress(self._done, self.study.total)

    def keep(self, index: int, table: pa.Table) -> None:
        """Write a finished block. Raises SweepError if other code or another study made it."""
        if not self._ours(table.schema):
            raise SweepError(
                f"block {index} comes from a worker with other sources or libraries: "
                "install the same on all"
            )
        with atomic_write(self._path(index)) as part:
            pq.write_table(table, part)

    def finish(self) -> None:
        """Merge the blocks into the output and delete them. Raises SweepError for a broken block."""
        provenance = gather(scenario=self.study.scenario)
        # The same study gives the same file, on every machine.
        portable = {name: text for name, text in provenance.items() if name not in OF_MACHINE}
        metadata = {
            "study": self.study.text,
            "study_content": self._key[_CONTENT],
            "plans": plans_json(self.study, self.bases),
            "sources": self._key[_PROGRAM],
            "provenance": json.dumps(portable),
            "grid": json.dumps([v.name for v in self.study.grid]),
            "variables": json.dumps([v.name for v in self.study.variables]),
        }

        schema = self._read(0).schema.with_metadata(metadata)
        with (
            atomic_write(self.output) as part,
            pq.ParquetWriter(part, schema, compression="zstd") as writer,
        ):
            for i in range(self.blocks):
                writer.write_table(self._read(i).cast(schema))
        shutil.rmtree(self.folder)

    def _read(self, index: int) -> pa.Table:
        path = self._path(index)
        try:
            table = pq.read_table(path)
        except pa.ArrowInvalid:
            raise SweepError(
                f"{path}: cannot be read: delete it, and run the same command again"
            ) from None
        runs = np.array(self._rows(index))
        if not self._ours(table.schema) or not np.array_equal(table["run"].to_numpy(), runs):
            raise SweepError(
                f"{path}: holds runs of another study, another block or other sources: delete it, and "
                "run the same command again"
            )
        return table

    def _ours(self, schema: pa.Schema) -> bool:
        metadata = schema.metadata or {}
        return all(metadata.get(k.encode()) == v.encode() for k, v in self._key.items())

    def _rows(self, index: int) -> range:
        first = index * self.study.block
        return range(first, min(first + self.study.block, self.study.total))

    def _path(self, index: int) -> Path:
        return self.folder / f"{index:08d}.parquet"


def processes(count: int) -> Runner:
    """Return a runner on this many processes of this machine; 1 stays in this process."""

    def run(blocks: Iterable[RunBlock]) -> Iterator[tuple[int, pa.Table]]:
        try:
            if count == 1:
                yield from map(_indexed, blocks)
                return
            with worker_pool(count) as pool:
                yield from as_completed_bounded(pool, _indexed, blocks, IN_FLIGHT * count)
        except BrokenProcessPool:
            raise SweepError(
                "a worker process was killed (out of memory?); finished blocks are kept: "
                "run the same command again"
            ) from None
        except MemoryError:
            raise SweepError(
                "not enough memory for a run; finished blocks are kept: shorten the runs, "
                "or give fewer --jobs"
            ) from None

    return run


def _indexed(block: RunBlock) -> tuple[int, pa.Table]:
    return block.index, run_block(block)


def device_runner(maker: OnDevice) -> Runner:
    """Return a runner in this process: many blocks at once, or one by one where the device leaves runs."""

    def run(blocks: Iterable[RunBlock]) -> Iterator[tuple[int, pa.Table]]:
        left, more, runs_left = iter(blocks), 0, 0
        while block := next(left, None):
            several = [block, *islice(left, more)]
            columns = {
                name: [value for part in several for value in part.columns[name]]
                for name in block.columns
            }
            table = run_block(replace(block, columns=columns), maker)
            before, runs_left = runs_left, maker.left.total()
            more = AT_ONCE // block.study.block if runs_left == before else 0
            first = 0
            for part in several:
                count = len(part.columns["run"])
                yield part.index, table.slice(first, count)
                first += count

    return run


def dask_runner(address: str) -> Runner:
    """Return a runner on the Dask cluster whose scheduler listens at an address (tcp://HOST:PORT).

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


def outcome_counts(path: Path) -> dict[str, int]:
    """Return how many runs of a result ended in each status."""
    status = pq.read_table(path, columns=["status"])["status"]
    return {name: pc.sum(pc.equal(status, name)).as_py() for name in ("ok", "diverged", "refused")}
