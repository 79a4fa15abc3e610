"""The worst runs of a sweep: those that fell first, then by a metric."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .results import Results


@dataclass(frozen=True)
class Worst:
    """One run: how it ended, and what the study's entries were in it."""

    run: int
    controller: str
    ended: str  # in words
    fell: bool
    value: float | None  # of the metric; None where it has none
    varied: dict[str, Any]


def worst_runs(results: Results, metric: str, count: int = 10) -> list[Worst]:
    """Return the worst runs: diverged ones by when, then fallen ones by how far, then by the metric.

    Runs that stood without the metric (which never settled, for one) come before those that have it.
    Refused runs were not made and are none of them.
    """
    fallen = results.fallen
    values = np.abs(results.column(metric))
    swing = np.maximum(np.abs(results.column("theta_min_deg")), results.column("theta_max_deg"))
    until = results.column("diverged_at_s")
    rows = np.flatnonzero(~np.isnan(fallen)).tolist()

    def badness(i: int) -> tuple[float, ...]:
        if not np.isnan(until[i]):
            return 0.0, until[i]
        if fallen[i] == 1.0:
            return 1.0, -swing[i]
        return (2.0, 0.0) if np.isnan(values[i]) else (3.0, -values[i])

    rows.sort(key=lambda i: (*badness(i), i))
    names = [v.name for v in results.study.variables]
    chosen = results.table.take(rows[:count]).to_pylist()
    cases = []
    for i, row in zip(rows, chosen, strict=False):
        ended = "stood"
        if not np.isnan(until[i]):
            ended = f"diverged at {until[i]:.3g} s"
        elif fallen[i] == 1.0:
            ended = f"fell, up to {swing[i]:.0f}°"
        value = None if np.isnan(values[i]) else float(values[i])
        varied = {name: row[name] for name in names}
        cases.append(
            Worst(row["run"], row["controller"], ended, bool(fallen[i] == 1.0), value, varied)
        )
    return cases
