"""Which of a study's drawn parameters matters: Sobol indices, by `scipy.stats.sobol_indices`.

A first-order index is the share of a metric's variance that a parameter causes alone, a total index the share
to which it contributes. The runs are those of a sweep, at points of a scrambled Sobol sequence; everything
else that is drawn by a seed (noise, links, random pulses) is from the study's first draw in all runs.

A run that fell has no comparable metric. It counts as the worst of the runs that stood; `Sensitivity.filled`
is the number of such runs. How often the trunk fell is itself a metric, `FELL`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
from scipy.stats import bootstrap, qmc, sobol_indices

from trunk_core.arrays import Floats
from trunk_core.errors import StudyError
from trunk_core.results import Count, Result
from trunk_runs.offline_recording import Progress

from .rows import Bases
from .statistics import CONFIDENCE, FELL, Estimate
from .study import StudySpec, Variable, design
from .sweep_execution import RunBlock, Runner
from .sweep_results import METRICS, Results

RESAMPLES = 999
_BELOW_1 = 1.0 - 2.0**-53
_SEED = 1  # of the scrambling and of the resampling: the same study gives the same indices


@dataclass(frozen=True)
class Index:
    """One parameter's part in the variance of a metric, with intervals at 95 %."""

    name: str
    first: Estimate
    total: Estimate


@dataclass(frozen=True)
class Sensitivity:
    """What makes one metric of one controller vary; no ``parameters`` if it does not."""

    controller: str
    metric: Annotated[str, "fallen: 1 where the trunk fell, else 0"]
    runs: Count
    fell: Count
    filled: Annotated[Count, "Runs without the metric; they count as the worst of the others"]
    doubtful: Annotated[bool, "More than 5 % are filled"]
    parameters: Annotated[
        tuple[Index, ...], "The largest total first; empty: the metric does not vary"
    ]


@dataclass(frozen=True)
class SensitivityResult(Result, document="study-sensitivity-1"):
    """The document of ``trunk sweep --sobol``."""

    study: str
    n: Annotated[int, "Base points"]
    runs: Count
    indices: Sequence[Sensitivity]


def check_sensitivity(study: StudySpec, n: int, metrics: tuple[str, ...]) -> None:
    """Raise StudyError for a study without two drawn entries, with a grid, for a bad n or metric."""
    for v in study.grid:
        if len(v.values) > 1:
            raise StudyError(
                f"{study.source}: vary.{v.name}: a grid of {len(v.values)} values: give a distribution, "
                "or one value"
            )
    if len(_drawn(study)) < 2:
        raise StudyError(
            f"{study.source}: vary: two or more drawn entries are needed, not {len(_drawn(study))}"
        )
    if n < 2 or n & (n - 1):
        raise StudyError(f"--sobol is {n}: a power of two from 2 is needed, such as {_near(n)}")
    for metric in metrics:
        if metric not in METRICS:
            raise StudyError(f"no metric {metric!r}: one of {', '.join(METRICS)}")


def total_runs(study: StudySpec, n: int) -> int:
    """Return how many runs the indices of all controllers need."""
    return n * (len(_drawn(study)) + 2) * len(study.contenders)


def sensitivities(
    study: StudySpec,
    bases: Bases,
    n: int,
    metrics: tuple[str, ...],
    runner: Runner,
    progress: Progress = lambda done, of: None,
) -> list[Sensitivity]:
    """Return the indices of falls and of some metrics, controller by controller.

    They are checked by `check_sensitivity`. Raises StudyError for a combination of values that is refused.
    """
    done, of = 0, total_runs(study, n)
    tables: dict[int, pa.Table] = {}
    for index, table in runner(_blocks(study, bases, _columns(study, n))):
        tables[index] = table
        done += len(table)
        progress(done, of)
    table = pa.concat_tables([tables[i] for i in sorted(tables)])
    _check_all_ran(study, table)
    results = Results(Path(study.source), table, (), study.text)
    return [
        sensitivity
        for contender in study.contenders
        for sensitivity in _of_one(study, results.of(contender.label), n, (FELL, *metrics))
    ]


def _columns(study: StudySpec, n: int) -> dict[str, list[Any]]:
    """Return the columns of all runs: for each controller the matrices A, B, and A with each column of B."""
    names = [v.name for v in _drawn(study)]
    u = qmc.Sobol(2 * len(names), rng=np.random.default_rng(_SEED)).random(n)
    u = np.minimum(u, _BELOW_1)
    a, b = u[:, : len(names)], u[:, len(names) :]
    points = [a, b]
    for i in range(len(names)):
        mixed = a.copy()
        mixed[:, i] = b[:, i]
        points.append(mixed)
    count, controllers = len(points) * n, len(study.contenders)
    columns = {name: values * count * controllers for name, values in design(study, 0, 1).items()}
    for v, u in zip(_drawn(study), np.concatenate(points).T, strict=True):
        assert v.distribution is not None
        columns[v.name] = v.distribution.at(u) * controllers
    columns["run"] = list(range(count * controllers))
    columns["controller"] = [c.label for c in study.contenders for _ in range(count)]
    return columns


def _blocks(study: StudySpec, bases: Bases, columns: dict[str, list[Any]]) -> Iterator[RunBlock]:
    for index, first in enumerate(range(0, len(columns["run"]), study.block)):
        rows = slice(first, first + study.block)
        part = {name: values[rows] for name, values in columns.items()}
        yield RunBlock(index, study, bases, part, "")


def _check_all_ran(study: StudySpec, table: pa.Table) -> None:
    for row in table.select(["controller", "status", "reason"]).to_pylist():
        if row["status"] == "refused":
            raise StudyError(
                f"{study.source}: {row['controller']}: some drawn values do not fit together: "
                f"{row['reason']}: narrow the distributions"
            )


def _of_one(
    study: StudySpec, results: Results, n: int, metrics: tuple[str, ...]
) -> Iterator[Sensitivity]:
    """Yield one controller's indices, metric by metric."""
    fell = results.fallen == 1.0
    columns, lacking = [], []
    for metric in metrics:
        values = fell * 1.0 if metric == FELL else results.ranked(metric)
        lacks = np.zeros(len(fell), bool) if metric == FELL else fell | np.isnan(values)
        worst = max(values[~lacks], key=abs, default=0.0)
        columns.append(np.where(lacks, worst, values))
        lacking.append(int(np.count_nonzero(lacks)))
    parts = np.array(columns).reshape(len(metrics), -1, n)
    estimates = _estimates(parts)
    for k, metric in enumerate(metrics):
        indices = [
            Index(v.name, *pair) for v, pair in zip(_drawn(study), estimates[k], strict=True)
        ]
        indices.sort(key=lambda index: -index.total.value)
        yield Sensitivity(
            results.controllers[0],
            metric,
            len(fell),
            int(np.count_nonzero(fell)),
            lacking[k],
            lacking[k] > 0.05 * len(fell),
            tuple(indices) if np.ptp(columns[k]) > 0.0 else (),
        )


def _estimates(parts: Floats) -> list[list[tuple[Estimate, Estimate]]]:
    """Return first-order and total index, [metric][entry], of outputs [metric, 2 + entries, n]."""
    metrics, matrices, n = parts.shape
    entries = matrices - 2

    def indices(which: Any) -> Floats:
        chosen = parts[:, :, which]
        outputs = {
            "f_A": chosen[:, 0],
            "f_B": chosen[:, 1],
            "f_AB": chosen[:, 2:].transpose(1, 0, 2),
        }
        sobol = sobol_indices(func=outputs, n=n)
        both = np.array([sobol.first_order, sobol.total_order])
        return both.reshape(2, metrics, entries)

    value = indices(np.arange(n))
    interval = bootstrap(
        (np.arange(n),),
        indices,
        vectorized=False,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(_SEED),
    ).confidence_interval

    def estimate(k: int, metric: int, entry: int) -> Estimate:
        at = k, metric, entry
        return Estimate(float(value[at]), float(interval.low[at]), float(interval.high[at]))

    return [
        [(estimate(0, m, i), estimate(1, m, i)) for i in range(entries)] for m in range(metrics)
    ]


def _drawn(study: StudySpec) -> list[Variable]:
    return [v for v in study.variables if v.distribution is not None]


def _near(n: int) -> str:
    below = 1 << max(1, max(n, 2).bit_length() - 1)
    return f"{below} or {2 * below}"
