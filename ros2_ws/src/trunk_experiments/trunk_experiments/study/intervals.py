"""Intervals at 95 %: of a share, by Wilson; of a mean and a median, by the bootstrap."""

from __future__ import annotations

from math import inf, nan
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest, bootstrap

from trunk_msgs_util.recording.joint_arrays import Floats

CONFIDENCE = 0.95
RESAMPLES = 5000
_SEED = 1  # of the resampling: the same results give the same intervals
_AT_ONCE = 2_000_000  # resampled numbers in memory


class Estimate(NamedTuple):
    """A number with the bounds of its interval; low > high where there are too few values."""

    value: float
    low: float
    high: float

    @property
    def known(self) -> bool:
        """True if there is an interval."""
        return self.low <= self.high


NOTHING = Estimate(nan, inf, -inf)


def wilson(count: int, of: int) -> Estimate:
    """Return a share and its Wilson score interval; `NOTHING` of nothing."""
    if not of:
        return NOTHING
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
