"""A sweep's results, read back: columns, the study in the metadata, who fell."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from trunk_msgs_util.recording.joint_arrays import Floats

from ..analysis.metrics import QUANTITIES, RunMetrics
from ..errors import StudyError
from .file import parse_study
from .resolved import bases_from
from .study import StudySpec
from .targets import Bases

FALLEN_DEG = 90.0  # a trunk this far from the vertical has fallen
METRICS = tuple(RunMetrics.__dataclass_fields__)


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
        return tuple(dict.fromkeys(self.table.column("controller").to_pylist()))

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

    def judged(self, metric: str) -> Floats:
        """Return a metric's values, as magnitudes where a smaller magnitude is better.

        The smallest and the largest angle keep their signs. Raises StudyError for another name.
        """
        values = self.column(metric)
        known = QUANTITIES.get(metric)
        return values if known and not known.judged else np.abs(values)

    @property
    def fallen(self) -> Floats:
        """1.0 if the loop diverged or the trunk fell, 0.0 if it stayed up, NaN for refused runs."""
        status = np.array(self.table["status"].to_pylist(), dtype=object)
        lies = np.maximum(self.column("theta_max_deg"), -self.column("theta_min_deg")) >= FALLEN_DEG
        return np.where(status == "refused", np.nan, (status == "diverged") | lies)


def _names(text: bytes | None) -> tuple[str, ...] | None:
    """Return a list of names from its JSON; None for anything else."""
    try:
        names = json.loads(text or b"")
    except ValueError:
        return None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return None
    return tuple(names)
