"""One run of a sweep again: its plan, and whether its result has the bits of its row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trunk_msgs_util.files import atomic_write
from trunk_sim.simulation import DivergedError

from ..analysis.run_table import table_and_metrics
from ..errors import StudyError
from ..plans.plan import RunPlan
from ..recorded.run import RecordedRun
from ..runs.offline_recording import Progress, record_offline
from .results import METRICS, Results
from .rows import plan_of
from .study import design


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
        at = self.results.table["run"].to_pylist().index(self.row["run"])
        return bool(self.results.fallen[at])

    @property
    def place(self) -> str:
        """Where errors say that something is wrong."""
        return f"{self.results.path}: run {self.row['run']}"


def study_run(results: Results, run: int) -> StudyRun:
    """Return one run of a sweep.

    Raises StudyError for a number that is not in the results, for a run that was refused, and for a row
    that is not the one that the study in the file makes.
    """
    numbers = results.table["run"].to_pylist()
    if run not in numbers:
        raise StudyError(
            f"{results.path}: no run {run}: they are numbered {min(numbers)} to {max(numbers)}"
        )
    row = results.table.slice(numbers.index(run), 1).to_pylist()[0]
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
        differing = [name for name, value in outcome.items() if run.row[name] != value]
        if differing:
            deviations = ", ".join(
                f"{name} {outcome[name]!r}, not {run.row[name]!r}" for name in differing
            )
            raise StudyError(f"{run.place}: run again it gives {deviations}: {_why(run.results)}")
    return diverged


def _outcome(path: Path, diverged: DivergedError | None) -> dict[str, Any]:
    """Return status, instant of divergence and metrics of a recording, as a row has them."""
    table, metrics = table_and_metrics(RecordedRun.open(path))
    if diverged is not None:
        return {
            "status": "diverged",
            "diverged_at_s": float(table.t[-1]),
            **dict.fromkeys(METRICS),
        }
    return {"status": "ok", "diverged_at_s": None, **metrics.as_dict()}


def _why(results: Results) -> str:
    """Return the likely reason why the bits differ, and what to do."""
    from .sweep import sources

    swept = (results.table.schema.metadata or {}).get(b"sources", b"").decode()
    if swept != sources():
        return "it was swept by other code, libraries or arithmetic: sweep the study again here"
    return "the file was changed since: sweep the study again"
