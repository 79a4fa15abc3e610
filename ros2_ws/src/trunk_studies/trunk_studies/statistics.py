"""What each controller of a sweep did, and how they compare: falls, distributions, paired differences.

Intervals are at 95 %: of a share, by Wilson; of a mean and a median, by the bootstrap. Differences are over
the same draws.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import inf, isnan, nan
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from trunk_core.arrays import Floats
from trunk_core.errors import StudyError
from trunk_core.results import ALSO, OMITTED, Count, Keyword, Known, Result
from trunk_core.text import shell_words
from trunk_evidence.run_metrics import QUANTITIES

from .study import shown
from .sweep_results import METRICS, Results

CONFIDENCE = 0.95
RESAMPLES = 5000
_SEED = 1  # of the resampling: the same results give the same intervals
_AT_ONCE = 2_000_000  # resampled numbers in memory
BINS = 24
_MOST = 99.0  # percent of the values that the bins span; those above are in the last one
FELL = "fallen"
PAIR = "pair"  # grid point and draw, by which runs are paired


class Estimate(NamedTuple):
    """A number with the bounds of its interval; low > high where there are too few values."""

    value: Known
    low: Known
    high: Annotated[Known, "low and high bound the value at 95 %; null: too few runs"]

    @property
    def known(self) -> bool:
        """True if there is an interval."""
        return self.low <= self.high


NOTHING = Estimate(nan, inf, -inf)


def wilson(count: int, of: int) -> Estimate:
    """Return a share and its Wilson score interval; `NOTHING` of nothing."""
    if not of:
        return NOTHING
    from scipy.stats import binomtest  # takes long to load

    interval = binomtest(count, of).proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(count / of, float(interval.low), float(interval.high))


def mean_interval(values: Floats) -> Estimate:
    """Return the mean with its percentile bootstrap interval."""

    def mean(x: Floats, axis: int) -> Floats:
        return np.stack([np.mean(x, axis=axis)])

    return _resampled(values, mean)[0]


def mean_and_median(values: Floats) -> tuple[Estimate, Estimate]:
    """Return both with their percentile bootstrap intervals, over the same resamples."""

    def both(x: Floats, axis: int) -> Floats:
        return np.stack([np.mean(x, axis=axis), np.median(x, axis=axis)])

    mean, median = _resampled(values, both)
    return mean, median


def _resampled(values: Floats, statistic: Any) -> list[Estimate]:
    """Return a statistic [K] of some values with intervals; without them for a single value or none."""
    count = len(values)
    if count == 0:
        return [NOTHING, NOTHING]
    points = statistic(values, 0)
    if count == 1:
        return [Estimate(float(point), inf, -inf) for point in points]
    if np.ptp(values) == 0.0:  # nothing to resample
        return [Estimate(float(point), float(point), float(point)) for point in points]
    from scipy.stats import bootstrap

    interval = bootstrap(
        (values,),
        statistic,
        vectorized=True,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        batch=max(1, _AT_ONCE // count),
        rng=np.random.default_rng(_SEED),
    ).confidence_interval
    bounds = zip(points, interval.low, interval.high, strict=True)
    return [Estimate(*map(float, numbers)) for numbers in bounds]


@dataclass(frozen=True)
class Falls:
    """How often a controller fell."""

    controller: str
    fell: Count
    runs: Annotated[Count, "Without those that were refused"]
    refused: Annotated[Count, "Not run"]
    share: Annotated[Estimate, "With Wilson's interval"]

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


class Bins(NamedTuple):
    """How many values are between each two edges."""

    edges: list[float]
    counts: Annotated[list[Count], "The last one also holds what is beyond the last edge"]


@dataclass(frozen=True)
class MetricDistribution:
    """Magnitudes of a metric (`Results.ranked`) over the runs in which the controller stood."""

    metric: str
    controller: str
    stood: Annotated[Count, "Runs in which it stood"]
    runs: Annotated[Count, "Of them, those that have the metric"]
    mean: Estimate
    median: Estimate
    histogram: Annotated[Bins | None, "The same bins for all controllers; null: no values"]

    @property
    def of_stood(self) -> str:
        """In how many of the runs that stood the metric exists: ``388``, or ``380/388``."""
        return str(self.runs) if self.runs == self.stood else f"{self.runs}/{self.stood}"


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
    results: Results, done: Callable[[], object] = lambda: None
) -> dict[str, list[MetricDistribution]]:
    """Return each metric's values by controller, with mean and median, over the runs that stood.

    ``done`` is called after each of them.
    """
    every = {name: results.of(name) for name in results.controllers}
    stood = {name: runs.only(runs.fallen == 0.0) for name, runs in every.items()}
    by_metric: dict[str, list[MetricDistribution]] = {}
    for metric in METRICS:
        ranked = {name: runs.ranked(metric) for name, runs in stood.items()}
        values = {name: column[~np.isnan(column)] for name, column in ranked.items()}
        edges = _edges(np.concatenate(list(values.values())))
        by_metric[metric] = []
        for name, own in values.items():
            bins = None if edges is None else Bins(edges.tolist(), _counts(own, edges))
            count = len(stood[name].table)
            by_metric[metric].append(
                MetricDistribution(metric, name, count, len(own), *mean_and_median(own), bins)
            )
            done()
    return by_metric


def _edges(values: Floats) -> Floats | None:
    """Return the edges of bins for all controllers' values of a metric; None if there are none.

    They span all values but the highest hundredth, which are in the last bin.
    """
    if not len(values):
        return None
    low, high = float(values.min()), float(np.percentile(values, _MOST))
    if high <= low:
        high = float(values.max())
    if high <= low:
        high = low + (abs(low) or 1.0) * 1e-3
    return np.linspace(low, high, BINS + 1, dtype=np.float64)


def _counts(values: Floats, edges: Floats) -> list[int]:
    """Return how many values are in each bin, those beyond the last edge in the last one."""
    counts, _ = np.histogram(np.minimum(values, edges[-1]), edges)
    return [int(count) for count in counts]


@dataclass(frozen=True)
class Worst:
    """One run: how it ended, and what the study's entries were in it."""

    run: Count
    controller: str
    fell: bool
    ended: Annotated[str, "In words"]
    value: Annotated[float | None, "Magnitude of the metric; null: it has none"]
    command: Annotated[str, "Makes the run again"]
    varied: Annotated[dict[str, Any], OMITTED]


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
        run, fell = row["run"], bool(fallen[i] == 1.0)
        command = _command(results.path, run)
        cases.append(Worst(run, row["controller"], fell, ended, value, command, varied))
    return cases


def _command(path: Path, run: int) -> str:
    return f"trunk study show {shell_words(str(path))} --run {run} -o run{run}.mcap"


@dataclass(frozen=True)
class PairedDifference:
    """A metric of ``first`` minus that of ``second``, over the pairs of draws in which both have it.

    ``low`` and ``high`` bound the mean difference at 95 %, in the metric's unit; low > high if fewer than two
    pairs are left. Made by `Sweep.compare`.
    """

    metric: str
    first: str
    second: str
    left_out: Annotated[Count, "Pairs in which one fell, was refused, or has no such metric"]
    pairs: Count
    mean: Known
    low: Known
    high: Annotated[Known, "low and high bound the mean at 95 %; null: too few pairs"]
    smaller: Annotated[
        Known, "Fraction of the pairs in which the first is smaller; ties count half"
    ]

    @property
    def mean_with_bounds(self) -> Estimate:
        """The mean difference and its interval."""
        return Estimate(self.mean, self.low, self.high)

    @property
    def ranked(self) -> bool:
        """False for a metric of which a smaller value is not a better one, such as the smallest angle."""
        return self.metric not in QUANTITIES or QUANTITIES[self.metric].ranked

    @property
    def verdict(self) -> Annotated[str, ALSO]:
        """Return in words what the interval shows; of a metric that is not ranked, nothing."""
        if not self.ranked:
            return "not ranked"
        if not self.low <= self.high:
            return "too few pairs"
        return f"{self.smaller_one} smaller" if self.smaller_one else "no difference shown"

    @property
    def smaller_one(self) -> str:
        """The controller whose value the interval shows to be smaller; empty: none, or not ranked."""
        if not self.ranked or not self.low <= self.high or self.low <= 0.0 <= self.high:
            return ""
        return self.first if self.high < 0.0 else self.second


def compare_study(
    results: Results, metrics: tuple[str, ...] = METRICS, done: Callable[[], object] = lambda: None
) -> list[PairedDifference]:
    """Return all pairs of controllers, metric by metric, beginning with how often each falls.

    Runs are paired by grid point and draw. Errors that may be negative are compared by their
    magnitude, the smallest and the largest angle with their signs. ``done`` is called after each difference.
    Raises StudyError for a single controller or an unknown metric.
    """
    names = results.controllers
    if len(names) < 2:
        raise StudyError(f"{results.path}: one controller, {names[0]!r}: nothing to compare")
    for metric in metrics:
        if metric not in METRICS:
            raise StudyError(f"no metric {metric!r}: one of {', '.join(METRICS)}")
    by_name = {name: _sorted(results.of(name)) for name in names}
    differences = []
    for metric in (FELL, *metrics):
        for first, second in combinations(names, 2):
            a, b = by_name[first], by_name[second]
            if not np.array_equal(a[PAIR], b[PAIR]):
                raise StudyError(
                    f"{results.path}: {first!r} and {second!r} do not have the same draws: rows are missing"
                )
            differences.append(difference_of(metric, first, second, a[metric], b[metric]))
            done()
    return differences


@dataclass(frozen=True)
class CompareStudyResult(Result, document="compare-study-1"):
    """The document of ``trunk study compare``."""

    study: Annotated[Path, "The sweep's file"]
    falls: Annotated[Sequence[Falls], "How often each controller fell"]
    distributions: Annotated[Sequence[MetricDistribution], "Over the runs in which it stood"]
    differences: Sequence[PairedDifference]


def _sorted(results: Results) -> dict[str, Floats]:
    """Return one controller's columns in the order of grid points and draws; NaN where it fell."""
    order = np.lexsort((results.column("draw"), results.column("point")))
    fallen = results.fallen[order]
    columns = {name: results.ranked(name)[order] for name in METRICS}
    return {
        PAIR: np.stack([results.column("point")[order], results.column("draw")[order]]),
        FELL: fallen,
        **{name: np.where(fallen == 0.0, values, np.nan) for name, values in columns.items()},
    }


def difference_of(metric: str, first: str, second: str, a: Floats, b: Floats) -> PairedDifference:
    """Return ``a - b`` of a metric, by pairs; NaN: there is none."""
    both = ~(np.isnan(a) | np.isnan(b))
    differences = a[both] - b[both]
    count = len(differences)
    left_out = len(a) - count
    if count < 2:
        return PairedDifference(metric, first, second, left_out, count, nan, inf, -inf, nan)
    smaller = float(np.mean(differences < 0.0) + 0.5 * np.mean(differences == 0.0))
    mean = mean_interval(differences)
    return PairedDifference(metric, first, second, left_out, count, *mean, smaller)


class DrawnRuns(NamedTuple):
    """A controller on some draws."""

    controller: str
    metric: Annotated[Floats, OMITTED]  # of each run, NaN where the trunk fell

    @property
    def fell(self) -> Annotated[int, Keyword("minimum", 0), ALSO]:
        """How many fell."""
        return int(np.isnan(self.metric).sum())

    @property
    def runs(self) -> Annotated[int, Keyword("minimum", 1), ALSO]:
        """How many there are."""
        return len(self.metric)

    @property
    def share(self) -> Annotated[Estimate, ALSO]:
        """The share of falls with Wilson's interval."""
        return wilson(self.fell, self.runs)

    @property
    def mean(self) -> Annotated[Known, ALSO]:
        """The metric's mean over the runs that stood; NaN if none did."""
        return float(np.nanmean(self.metric)) if self.fell < self.runs else nan

    def less(self, other: DrawnRuns, metric: str) -> PairedDifference:
        """Return the metric of this one minus the other's, over the draws in which both stood."""
        return difference_of(metric, self.controller, other.controller, self.metric, other.metric)
