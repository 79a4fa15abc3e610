"""Compares a sweep's controllers: differences over the same draws, with confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import inf, nan

import numpy as np
from scipy.stats import bootstrap

from trunk_msgs_util.recording.joint_arrays import Floats

from ..errors import StudyError
from .results import METRICS, Results

RESAMPLES = 5000
CONFIDENCE = 0.95
_SEED = 1  # of the resampling: the same results give the same intervals
FELL = "fallen"
PAIR = "pair"  # grid point and draw, by which runs are paired


@dataclass(frozen=True)
class PairedDifference:
    """A metric of ``first`` minus that of ``second``, over the pairs in which both have it.

    ``low`` and ``high`` bound the mean difference at 95 %; low > high if fewer than two pairs are left.
    """

    metric: str
    first: str
    second: str
    pairs: int
    mean: float
    low: float
    high: float
    smaller: float  # fraction of the pairs in which the first's value is smaller; a tie counts half

    @property
    def verdict(self) -> str:
        """Return in words what the interval shows."""
        if not self.low <= self.high:
            return "too few pairs"
        if self.low <= 0.0 <= self.high:
            return "no difference shown"
        return f"{self.first if self.high < 0.0 else self.second} smaller"


def compare_study(results: Results, metrics: tuple[str, ...] = METRICS) -> list[PairedDifference]:
    """Return all pairs of controllers, metric by metric, beginning with how often each falls.

    Runs are paired by grid point and draw. Angles and errors that may be negative are compared by their
    magnitude. Raises StudyError for a single controller or an unknown metric.
    """
    names = results.controllers
    if len(names) < 2:
        raise StudyError(f"{results.path}: one controller, {names[0]!r}: nothing to compare")
    for metric in metrics:
        if metric not in METRICS:
            raise StudyError(f"no metric {metric!r}: one of {', '.join(METRICS)}")
    by_name = {name: _sorted(results.of(name)) for name in names}
    found = []
    for metric in (FELL, *metrics):
        for first, second in combinations(names, 2):
            a, b = by_name[first], by_name[second]
            if not np.array_equal(a[PAIR], b[PAIR]):
                raise StudyError(
                    f"{results.path}: {first!r} and {second!r} do not have the same draws: rows are missing"
                )
            found.append(_difference(metric, first, second, a[metric], b[metric]))
    return found


def _sorted(results: Results) -> dict[str, Floats]:
    """Return one controller's columns in the order of grid points and draws; NaN where it fell."""
    order = np.lexsort((results.column("draw"), results.column("point")))
    fallen = results.fallen[order]
    columns = {name: np.abs(results.column(name)[order]) for name in METRICS}
    return {
        PAIR: np.stack([results.column("point")[order], results.column("draw")[order]]),
        FELL: fallen,
        **{name: np.where(fallen == 0.0, values, np.nan) for name, values in columns.items()},
    }


def _difference(metric: str, first: str, second: str, a: Floats, b: Floats) -> PairedDifference:
    both = ~(np.isnan(a) | np.isnan(b))
    differences = a[both] - b[both]
    count = len(differences)
    if count < 2:
        return PairedDifference(metric, first, second, count, nan, inf, -inf, nan)
    smaller = float(np.mean(differences < 0.0) + 0.5 * np.mean(differences == 0.0))
    mean = float(np.mean(differences))
    if np.ptp(differences) == 0.0:  # nothing to resample
        return PairedDifference(metric, first, second, count, mean, mean, mean, smaller)
    interval = bootstrap(
        (differences,),
        np.mean,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        batch=max(1, 2_000_000 // count),
        rng=np.random.default_rng(_SEED),
    ).confidence_interval
    low, high = float(interval.low), float(interval.high)
    return PairedDifference(metric, first, second, count, mean, low, high, smaller)
