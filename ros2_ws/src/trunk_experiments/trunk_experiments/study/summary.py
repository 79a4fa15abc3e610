"""What each controller of a sweep did: how often it fell, else its metrics; the worst runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import isnan
from typing import Any

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Floats

from .intervals import Estimate, mean_and_median, wilson
from .results import METRICS, Results
from .units import shown

BINS = 24
_MOST = 99.0  # percent of the values that the bins span; those above are in the last one


@dataclass(frozen=True)
class Falls:
    """How often a controller fell; refused runs, which were not made, are not among ``runs``."""

    controller: str
    fell: int
    runs: int
    refused: int
    share: Estimate

    @property
    def bounds(self) -> str:
        """The interval in words: ``up to 3.7 %`` where none fell; empty if there were no runs."""
        if not self.share.known:
            return ""
        low, high = percent(self.share.low), percent(self.share.high)
        if self.fell == 0:
            return f"up to {high}"
        return f"at least {low}" if self.fell == self.runs else f"{low} to {high}"

    def describe(self) -> str:
        """Return it in words: ``0 of 100, up to 3.7 %``."""
        return ", ".join(filter(None, [f"{self.fell} of {self.runs}", self.bounds]))


@dataclass(frozen=True)
class MetricDistribution:
    """A metric's values (`Results.judged`) over the runs that stood and have the metric."""

    metric: str
    controller: str
    stood: int
    values: Floats
    mean: Estimate
    median: Estimate

    @property
    def of_stood(self) -> str:
        """In how many of the runs that stood the metric exists: ``388``, or ``380/388``."""
        count = len(self.values)
        return str(count) if count == self.stood else f"{count}/{self.stood}"


def percent(share: float) -> str:
    """Return a share with two significant digits: ``3.7 %``."""
    percentage = 100.0 * share
    return f"{percentage:.2g} %" if 0.0 <= percentage < 99.5 else f"{percentage:.3g} %"


def number_text(value: float) -> str:
    """Return a number with three significant digits, or with all digits before the point."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.3g}"


def estimate_text(estimate: Estimate) -> str:
    """Return a number and its interval: ``1.23 [1.2…1.26]``; empty where there is no number."""
    if isnan(estimate.value):
        return ""
    bounds = (
        f" [{number_text(estimate.low)}…{number_text(estimate.high)}]" if estimate.known else ""
    )
    return number_text(estimate.value) + bounds


def falls(results: Results) -> list[Falls]:
    """Return how often each controller fell, in the study's order."""
    counts = []
    for name in results.controllers:
        fallen = results.of(name).fallen
        runs = int(np.count_nonzero(~np.isnan(fallen)))
        fell = int(np.count_nonzero(fallen == 1.0))
        counts.append(Falls(name, fell, runs, len(fallen) - runs, wilson(fell, runs)))
    return counts


def distributions(
    results: Results, metrics: tuple[str, ...] = METRICS, done: Callable[[], object] = lambda: None
) -> dict[str, list[MetricDistribution]]:
    """Return each metric's values by controller, with mean and median, over the runs that stood.

    ``done`` is called after each of them.
    """
    stood = {name: _standing(results.of(name)) for name in results.controllers}
    by_metric: dict[str, list[MetricDistribution]] = {metric: [] for metric in metrics}
    for metric, name in product(metrics, stood):
        by_metric[metric].append(_distribution(metric, stood[name], name))
        done()
    return by_metric


def _standing(results: Results) -> Results:
    return results.only(results.fallen == 0.0)


def _distribution(metric: str, results: Results, controller: str) -> MetricDistribution:
    values = results.judged(metric)
    values = values[~np.isnan(values)]
    mean, median = mean_and_median(values)
    return MetricDistribution(metric, controller, len(results.table), values, mean, median)


def bins_of(spreads: list[MetricDistribution]) -> Floats | None:
    """Return the edges of bins for all controllers' values of a metric; None if there are none.

    They span all values but the highest hundredth, which are in the last bin.
    """
    values = np.concatenate([spread.values for spread in spreads])
    if not len(values):
        return None
    low, high = float(values.min()), float(np.percentile(values, _MOST))
    if high <= low:
        high = float(values.max())
    if high <= low:
        high = low + (abs(low) or 1.0) * 1e-3
    return np.linspace(low, high, BINS + 1, dtype=np.float64)


def counts_in(values: Floats, edges: Floats) -> list[int]:
    """Return how many values are in each bin, those beyond the last edge in the last one."""
    counts, _ = np.histogram(np.minimum(values, edges[-1]), edges)
    return [int(count) for count in counts]


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
        varied = {name: shown(results.study, name, row[name]) for name in names}
        cases.append(
            Worst(row["run"], row["controller"], ended, bool(fallen[i] == 1.0), value, varied)
        )
    return cases
