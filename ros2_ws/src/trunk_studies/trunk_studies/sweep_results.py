"""A sweep's results, read back: columns, who fell; two of them, bit by bit; one of their runs made again."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from trunk_core.arrays import Floats, Integers
from trunk_core.errors import StudyError
from trunk_core.files import atomic_write
from trunk_core.results import Count, Result, known
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_metrics import RANKED, Metrics
from trunk_evidence.run_table import table_and_metrics
from trunk_evidence.verdict import same, ulps
from trunk_runs.offline_recording import Progress, record_offline
from trunk_runs.plan import RunPlan
from trunk_sim.simulation import DivergedError

from .rows import Bases, bases_from, plan_of
from .study import StudySpec, design, parse_study
from .sweep_execution import sources

METRICS = tuple(Metrics.__dataclass_fields__)
Cell = float | int | str | bool | None  # of a column
_TOLD = ("study", "plans", "grid", "variables", "sources")


@dataclass(frozen=True)
class Results:
    """A table of runs with the names of what varied."""

    path: Path
    table: pa.Table
    grid: tuple[str, ...]
    study_text: str
    plans: str | None = None  # JSON of the plans that the runs start from

    @classmethod
    def read(cls, path: Path) -> Results:
        """Return the results in a Parquet file. Raises StudyError if it is not a sweep's."""
        if not path.exists():
            raise StudyError(f"{path}: there is no such file")
        if not path.is_file():  # pyarrow would read whatever is below a folder, and wait for a pipe
            kind = "a folder" if path.is_dir() else "not a regular file"
            raise StudyError(f"{path}: {kind}: give a Parquet file of trunk sweep")
        try:
            table = pq.read_table(path)
        except (pa.ArrowInvalid, pa.ArrowTypeError, OSError) as error:
            number = getattr(error, "errno", None)
            fault = f"cannot be read: {os.strerror(number)}" if number else "not a Parquet file"
            raise StudyError(f"{path}: {fault}: give the results of a trunk sweep") from None
        metadata = table.schema.metadata or {}
        grid = _names(metadata.get(b"grid"))
        if (
            b"study" not in metadata
            or grid is None
            or not {"controller", "status"} <= set(table.column_names)
        ):
            raise StudyError(f"{path}: not written by trunk sweep: no study in it")
        if not len(table):
            raise StudyError(f"{path}: there are no runs in it")
        plans = metadata.get(b"plans")
        return cls(
            path,
            table,
            grid,
            metadata[b"study"].decode(),
            None if plans is None else plans.decode(),
        )

    @property
    def study(self) -> StudySpec:
        """The study; raises StudyError if this version does not understand it."""
        return parse_study(self.study_text, f"the study in {self.path}")

    def bases(self) -> Bases:
        """Return the plans that the runs started from, as they were when they ran.

        Raises StudyError if the file holds none, or this version does not understand them.
        """
        if self.plans is None:
            raise StudyError(
                f"{self.path}: holds no plans of its runs: sweep the study again, or give --no-floquet"
            )
        return bases_from(self.study, self.plans, str(self.path))

    @property
    def controllers(self) -> tuple[str, ...]:
        """The controllers' labels, in the study's order."""
        return tuple(pc.unique(self.table["controller"]).to_pylist())

    def of(self, controller: str) -> Results:
        """Return one controller's rows."""
        chosen = self.table.filter(pc.equal(self.table["controller"], controller))
        return replace(self, table=chosen)

    def only(self, chosen: Any) -> Results:
        """Return the rows of which an array of bools [rows] is True."""
        return replace(self, table=self.table.filter(pa.array(chosen)))

    def column(self, name: str) -> Floats:
        """Return a column of numbers, NaN where there is none. Raises StudyError for another name."""
        if name not in self.table.column_names:
            raise StudyError(
                f"{self.path}: no column {name!r}: one of {', '.join(self.table.column_names)}"
            )
        try:
            values = self.table[name].cast(pa.float64()).to_numpy(zero_copy_only=False)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise StudyError(f"{self.path}: column {name!r} holds no numbers") from None
        return np.asarray(values, dtype=np.float64)

    def ranked(self, metric: str) -> Floats:
        """Return a column of numbers, as magnitudes where a smaller magnitude is better.

        The smallest and the largest angle keep their signs. Raises StudyError for another name.
        """
        values = self.column(metric)
        return np.abs(values) if metric in RANKED else values

    @property
    def fallen(self) -> Floats:
        """1.0 if the loop diverged or the trunk fell, 0.0 if it stayed up, NaN for refused runs.

        Raises StudyError for the results of a version that did not write down who fell.
        """
        if "fell" not in self.table.column_names:
            raise StudyError(
                f"{self.path}: no column 'fell': an earlier version swept it; sweep the study again"
            )
        diverged = pc.equal(self.table["status"], "diverged").to_numpy()
        return np.where(diverged, 1.0, self.column("fell"))


def _names(text: bytes | None) -> tuple[str, ...] | None:
    """Return a list of names from its JSON; None for anything else."""
    try:
        names = json.loads(text or b"")
    except ValueError:
        return None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return None
    return tuple(names)


class FirstCell(NamedTuple):
    """The first cell that differs: the smallest number of a run, and there the first column."""

    run: int
    column: str
    a: Annotated[Cell, "null: missing in the first"]
    b: Annotated[Cell, "null: missing in the second"]


@dataclass(frozen=True)
class StudyDiff(Result, document="diff-study-1"):
    """The document of ``trunk diff A B``, of two sweeps.

    The runs decide; the metadata help explain.
    """

    studies: Annotated[tuple[Path, Path], "The sweeps' files"]
    identical: Annotated[bool, "Every run of both has the same bits in the same columns"]
    runs_compared: Annotated[Count, "Those that both have"]
    differing_runs: Annotated[Count, "With those that only one has"]
    first: Annotated[FirstCell | None, "null: none"]
    furthest_ulps: Annotated[Count | None, "Between two numbers; null: none differ"]
    metadata: Sequence[str]

    def describe(self) -> str:
        """Return in one line whether and where the sweeps differ."""
        if self.first is None:
            return f"identical: {self.runs_compared} runs, bit for bit"
        shown = ["nothing" if value is None else repr(value) for value in self.first[2:]]
        most = "" if self.furthest_ulps is None else f"; at most {self.furthest_ulps} ULP apart"
        return (
            f"different in {self.differing_runs} runs; first in run {self.first.run}, {self.first.column}: "
            f"{shown[0]} in A, {shown[1]} in B{most}"
        )


def diff_studies(a: Results, b: Results) -> StudyDiff:
    """Compare two sweeps by their runs' numbers. Raises StudyError where these are missing or doubled."""
    here, there = _numbers(a), _numbers(b)
    shared, rows_a, rows_b = np.intersect1d(here, there, assume_unique=True, return_indices=True)
    furthest: int | None = None
    cells = [
        *(FirstCell(int(run), "run", int(run), None) for run in np.setdiff1d(here, there)[:1]),
        *(FirstCell(int(run), "run", None, int(run)) for run in np.setdiff1d(there, here)[:1]),
    ]
    differing = set(np.setxor1d(here, there).tolist())
    for name in dict.fromkeys([*a.table.column_names, *b.table.column_names]):
        pair = [_values(results.table, name, rows) for results, rows in ((a, rows_a), (b, rows_b))]
        for run, x, y in zip(shared.tolist(), *pair, strict=True):
            if type(x) is type(y) and (same(x, y) if isinstance(x, float) else x == y):
                continue
            differing.add(run)
            cells.append(FirstCell(run, name, x, y))
            apart = ulps(x, y) if isinstance(x, float) and isinstance(y, float) else None
            if apart is not None:
                furthest = max(apart, furthest or 0)
    first = min(cells, key=lambda cell: cell.run, default=None)  # keeps the columns' order
    return StudyDiff(
        (a.path, b.path),
        first is None,
        len(shared),
        len(differing),
        first,
        furthest,
        _metadata(a, b),
    )


def _numbers(results: Results) -> Integers:
    if "run" not in results.table.column_names:
        raise StudyError(f"{results.path}: no column 'run': sweep the study again")
    numbers = np.asarray(results.column("run"), dtype=np.int64)
    if len(np.unique(numbers)) != len(numbers):
        raise StudyError(f"{results.path}: a number of a run appears twice: sweep the study again")
    return numbers


def _values(table: pa.Table, name: str, rows: Integers) -> list[Cell]:
    if name not in table.column_names:
        return [None] * len(rows)
    values: list[Cell] = table[name].take(pa.array(rows)).to_pylist()
    return values


def _metadata(a: Results, b: Results) -> list[str]:
    """Name what differs in what the files say of themselves; only short values are shown."""
    here, there = (results.table.schema.metadata or {} for results in (a, b))
    lines = [
        f"{name}: not the same"
        for name in _TOLD
        if here.get(name.encode()) != there.get(name.encode())
    ]
    sides = [_provenance(metadata.get(b"provenance", b"")) for metadata in (here, there)]
    for key in sorted(sides[0].keys() | sides[1].keys()):
        x, y = (side.get(key, "(none)") for side in sides)
        if x != y:
            lines.append(f"provenance: {key}: {x} in A, {y} in B")
    return lines


def _provenance(text: bytes) -> dict[str, object]:
    try:
        provenance = json.loads(text or b"{}")
    except ValueError:
        return {}
    return provenance if isinstance(provenance, dict) else {}


@dataclass(frozen=True)
class StudyRun:
    """A row of a sweep with the plan of its run."""

    results: Results
    row: Mapping[str, Any]  # all columns
    plan: RunPlan

    @property
    def varied(self) -> dict[str, Any]:
        """What the study's entries were in this run, by name."""
        return {v.name: self.row[v.name] for v in self.results.study.variables}

    @property
    def fell(self) -> bool:
        """True if the trunk fell or the plant diverged."""
        return self.row["status"] == "diverged" or bool(self.row.get("fell"))

    @property
    def place(self) -> str:
        """Where errors say that something is wrong."""
        return f"{self.results.path}: run {self.row['run']}"


def study_run(results: Results, run: int) -> StudyRun:
    """Return one run of a sweep.

    Raises StudyError for a number that is not in the results, for a run that was refused, and for a row
    that is not the one that the study in the file makes.
    """
    numbers = results.table["run"]
    at = pc.index(numbers, run).as_py()
    if at < 0:
        first, last = pc.min_max(numbers).as_py().values()
        raise StudyError(f"{results.path}: no run {run}: they are numbered {first} to {last}")
    row = results.table.slice(at, 1).to_pylist()[0]
    if row["status"] == "refused":
        raise StudyError(
            f"{results.path}: run {run} was refused and not run: {row['reason']}; give another"
        )
    study = results.study
    if not 0 <= run < study.total:
        raise StudyError(
            f"{results.path}: run {run}: the study in the file has runs 0 to {study.total - 1}: "
            "sweep it again"
        )
    made = {name: values[0] for name, values in design(study, run, run + 1).items()}
    differing = [name for name, value in made.items() if row.get(name) != value]
    if differing:
        deviations = ", ".join(
            f"{name} {row.get(name)!r}, not {made[name]!r}" for name in differing
        )
        raise StudyError(
            f"{results.path}: run {run}: the study in the file does not give its {deviations}: sweep it again"
        )
    return StudyRun(results, row, plan_of(study, results.bases(), made))


def record_again(
    run: StudyRun, path: Path, overwrite: bool = False, progress: Progress = lambda done, of: None
) -> DivergedError | None:
    """Record the run offline; return why it diverged, as it did in the sweep, or None.

    Raises StudyError, and leaves the file as it was, if the bits of a metric or the divergence differ.
    """
    with atomic_write(path, overwrite=overwrite) as part:
        diverged = None
        try:
            record_offline(run.plan, part, overwrite=True, progress=progress)
        except DivergedError as error:
            diverged = error
        outcome = _outcome(part, diverged)
        outcome = {name: value for name, value in outcome.items() if name in run.row}
        differing = [name for name, value in outcome.items() if run.row[name] != value]
        if differing:
            deviations = ", ".join(
                f"{name} {outcome[name]!r}, not {run.row[name]!r}" for name in differing
            )
            raise StudyError(f"{run.place}: run again it gives {deviations}: {_why(run.results)}")
    return diverged


def _outcome(path: Path, diverged: DivergedError | None) -> dict[str, Any]:
    """Return status, fall, instant of divergence and metrics of a recording, as a row has them."""
    run = RecordedRun.open(path)
    table, metrics = table_and_metrics(run)
    status, at, numbers = "ok", None, metrics.as_dict()
    if diverged is not None:
        status, at, numbers = "diverged", float(table.t[-1]), dict.fromkeys(METRICS)
    fell = run.fall is not None
    values = {name: value and known(value) for name, value in numbers.items()}
    return {"status": status, "fell": fell, "diverged_at_s": at, **values}


def _why(results: Results) -> str:
    """Return the likely reason why the bits differ, and what to do."""
    swept = (results.table.schema.metadata or {}).get(b"sources", b"").decode()
    if swept != sources():
        return "it was swept by other code, libraries or arithmetic: sweep the study again here"
    return "the file was changed since: sweep the study again"
