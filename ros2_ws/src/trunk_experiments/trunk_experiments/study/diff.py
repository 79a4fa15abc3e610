"""Two sweeps' results compared, run by run and column by column, bit by bit."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from trunk_msgs_util.recording.joint_arrays import Integers

from ..errors import StudyError
from ..replay.bits import same, ulps
from .results import Results

_TOLD = ("study", "plans", "grid", "variables", "sources")


class FirstCell(NamedTuple):
    """The first cell that differs: the smallest number of a run, and there the first column."""

    run: int
    column: str
    a: object  # None: missing
    b: object


@dataclass
class StudyDiff:
    """All that differs between two sweeps. The runs decide; the metadata help explain."""

    compared: int = 0  # runs that both have
    differing: int = 0  # runs, those that only one has included
    first: FirstCell | None = None
    furthest: int | None = None  # ULPs, of the numbers that both have
    metadata: list[str] = field(default_factory=list)

    @property
    def identical(self) -> bool:
        """True where every run of both has the same bits in the same columns."""
        return self.first is None

    def describe(self) -> str:
        """Return in one line whether and where the sweeps differ."""
        if self.first is None:
            return f"identical: {self.compared} runs, bit for bit"
        shown = ["nothing" if value is None else repr(value) for value in self.first[2:]]
        most = "" if self.furthest is None else f"; at most {self.furthest} ULP apart"
        return (
            f"different in {self.differing} runs; first in run {self.first.run}, {self.first.column}: "
            f"{shown[0]} in A, {shown[1]} in B{most}"
        )


def diff_studies(a: Results, b: Results) -> StudyDiff:
    """Compare two sweeps by their runs' numbers. Raises StudyError where these are missing or doubled."""
    here, there = _numbers(a), _numbers(b)
    shared, rows_a, rows_b = np.intersect1d(here, there, assume_unique=True, return_indices=True)
    result = StudyDiff(len(shared), metadata=_metadata(a, b))
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
                result.furthest = max(apart, result.furthest or 0)
    result.differing = len(differing)
    result.first = min(cells, key=lambda cell: cell.run, default=None)  # keeps the columns' order
    return result


def _numbers(results: Results) -> Integers:
    if "run" not in results.table.column_names:
        raise StudyError(f"{results.path}: no column 'run': sweep the study again")
    numbers = np.asarray(results.column("run"), dtype=np.int64)
    if len(np.unique(numbers)) != len(numbers):
        raise StudyError(f"{results.path}: a number of a run appears twice: sweep the study again")
    return numbers


def _values(table: pa.Table, name: str, rows: Integers) -> list[object]:
    if name not in table.column_names:
        return [None] * len(rows)
    values: list[object] = table[name].take(pa.array(rows)).to_pylist()
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
