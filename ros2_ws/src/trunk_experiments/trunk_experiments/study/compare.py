"""Compares a sweep's controllers: differences over the same draws, with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from math import inf, nan

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Floats

from ..analysis.metrics import QUANTITIES
from ..errors import StudyError
from .intervals import Estimate, mean_interval
from .results import METRICS, Results

FELL = "fallen"
PAIR = "pair"  # grid point and draw, by which runs are paired


@dataclass(frozen=True)
class MeanDifference:
    """A metric of ``first`` minus that of ``second``, over the pairs in which both have it.

    ``low`` and ``high`` bound the mean difference at 95 %; low > high if fewer than two pairs are left.
    """

    metric: str
    first: str
    second: str
    left_out: int  # pairs in which one of them fell, was refused, or has no such metric
    pairs: int
    mean: float
    low: float
    high: float
    smaller: float  # fraction of the pairs in which the first's value is smaller; a tie counts half

    @property
    def mean_with_bounds(self) -> Estimate:
        """The mean difference and its interval."""
        return Estimate(self.mean, self.low, self.high)

    @property
    def judged(self) -> bool:
        """False for a metric of which a smaller value is not a better one, such as the smallest angle."""
        return self.metric not in QUANTITIES or QUANTITIES[self.metric].judged

    @property
    def verdict(self) -> str:
        """Return in words what the interval shows; of a metric that is not judged, nothing."""
        if not self.judged:
            return "not judged"
        if not self.low <= self.high:
            return "too few pairs"
        return f"{self.smaller_one} smaller" if self.smaller_one else "no difference shown"

    @property
    def smaller_one(self) -> str:
        """The controller whose value the interval shows to be smaller; empty: none, or not judged."""
        if not self.judged or not self.low <= self.high or self.low <= 0.0 <= self.high:
            return ""
        return self.first if self.high < 0.0 else self.second


def compare_study(
    results: Results, metrics: tuple[str, ...] = METRICS, done: Callable[[], object] = lambda: None
) -> list[MeanDifference]:
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


def _sorted(results: Results) -> dict[str, Floats]:
    """Return one controller's columns in the order of grid points and draws; NaN where it fell."""
    order = np.lexsort((results.column("draw"), results.column("point")))
    fallen = results.fallen[order]
    columns = {name: results.judged(name)[order] for name in METRICS}
    return {
        PAIR: np.stack([results.column("point")[order], results.column("draw")[order]]),
        FELL: fallen,
        **{name: np.where(fallen == 0.0, values, np.nan) for name, values in columns.items()},
    }


def difference_of(metric: str, first: str, second: str, a: Floats, b: Floats) -> MeanDifference:
    """Return ``a - b`` of a metric, by pairs; NaN: there is none."""
    both = ~(np.isnan(a) | np.isnan(b))
    differences = a[both] - b[both]
    count = len(differences)
    left_out = len(a) - count
    if count < 2:
        return MeanDifference(metric, first, second, left_out, count, nan, inf, -inf, nan)
    smaller = float(np.mean(differences < 0.0) + 0.5 * np.mean(differences == 0.0))
    mean = mean_interval(differences)
    return MeanDifference(metric, first, second, left_out, count, *mean, smaller)
