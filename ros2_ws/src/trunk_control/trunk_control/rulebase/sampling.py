"""A surface over (e, e_dot) as a table between peaks: exact where it can be, else as close as asked.

Pure: arrays in, arrays out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trunk_core.arrays import Floats

from ..fuzzy import bilinear
from ..rule_tables import MOST

Indices = npt.NDArray[np.intp]
Surface = Callable[[Floats, Floats], Floats]  # e, e_dot -> outputs in rows
EXACT = 1e-12  # of an output's span: rounding
CHECKS = 100_000
_SEED = 1
_LINES = 200  # intervals of the grid from which peaks are chosen, along each input
_REFINEMENTS, _MORE = (
    4,
    9,
)  # how often, and by how many lines, it becomes finer where the table is off most
# Of the tolerance, for one input alone: what is left is for the other, and for what lies between grid lines.
_SHARES = (0.95, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08)


class Table(NamedTuple):
    """Values at peaks, ``values[k, i, j]`` of output k at error peak i and rate peak j."""

    error_peaks: Floats
    rate_peaks: Floats
    values: Floats

    def at(self, error: Floats, rate: Floats) -> Floats:
        """Return the outputs (rows) at points: the centre average of the loop, with its bits."""
        i, a = _located(error, self.error_peaks)
        j, b = _located(rate, self.rate_peaks)
        columns = len(self.rate_peaks)
        flat = self.values.reshape(len(self.values), -1)
        return np.array([bilinear(row, i * columns + j, columns, a, b) for row in flat])  # type: ignore[arg-type]


class Deviation(NamedTuple):
    """The greatest distance of a table from a surface: as a share of the output's span, and where."""

    share: float
    output: int
    error: float
    rate: float
    distance: float  # in the output's unit


class Sampling(NamedTuple):
    """A table, and how far it is from the surface at the points of `check_points`."""

    table: Table
    deviation: Deviation

    @property
    def exact(self) -> bool:
        """Nothing but rounding."""
        return self.deviation.share <= EXACT


class Checked(NamedTuple):
    """Points and the surface's values there."""

    error: Floats
    rate: Floats
    values: Floats
    span: Floats  # of each output; 1 for a constant

    def deviation(self, table: Table) -> Deviation:
        """Return the table's greatest distance from the surface at these points."""
        distance = np.abs(table.at(self.error, self.rate) - self.values)
        share = distance / self.span[:, None]
        k, n = (int(index) for index in np.unravel_index(int(np.argmax(share)), share.shape))
        return Deviation(
            float(share[k, n]),
            k,
            float(self.error[n]),
            float(self.rate[n]),
            float(distance[k, n]),
        )


def check_points(
    surface: Surface, ranges: Sequence[Sequence[float]], count: int = CHECKS
) -> Checked:
    """Return the surface at ``count`` points, always the same, over the inputs' ranges."""
    generator = np.random.default_rng(_SEED)
    e, r = (generator.uniform(low, high, count) for low, high in ranges)
    values = surface(e, r)
    span = np.ptp(values, axis=1)
    rounding = 1e-9 * np.max(np.abs(values), axis=1)
    return Checked(e, r, values, np.where(span > rounding, span, 1.0))


def sample(
    surface: Surface,
    checked: Checked,
    ranges: Sequence[Sequence[float]],
    bends: Sequence[Sequence[float]],
    tolerance: float,
) -> Sampling:
    """Return the surface as a table: exact between the bends of its inputs, else within ``tolerance``.

    ``ranges``: of the inputs; ``bends``: where their membership functions bend. ``tolerance``: a share of
    each output's span. If no table of 64 x 64 is that close, the closest is returned.
    """
    for ends in ((), (0, 1)):
        peaks = [
            np.array(sorted({*bend, *(limits[end] for end in ends)}))
            for bend, limits in zip(bends, ranges, strict=True)
        ]
        if all(2 <= len(line) <= MOST for line in peaks):
            table = at_peaks(surface, peaks[0], peaks[1])
            sampling = Sampling(table, checked.deviation(table))
            if sampling.exact:
                return sampling
    return _adapted(surface, checked, ranges, bends, tolerance)


def at_peaks(surface: Surface, error_peaks: Floats, rate_peaks: Floats) -> Table:
    """Return the table of the surface's values at the peaks."""
    e, r = np.meshgrid(error_peaks, rate_peaks, indexing="ij")
    return Table(error_peaks, rate_peaks, surface(e.ravel(), r.ravel()).reshape(-1, *e.shape))


def _adapted(
    surface: Surface,
    checked: Checked,
    ranges: Sequence[Sequence[float]],
    bends: Sequence[Sequence[float]],
    tolerance: float,
) -> Sampling:
    """Return the smallest table within the tolerance, of peaks chosen along either input alone."""
    lines = [
        np.array(sorted({*np.linspace(limits[0], limits[1], _LINES + 1), *bend, *limits}))
        for limits, bend in zip(ranges, bends, strict=True)
    ]
    best = _closest(surface, checked, lines, tolerance)
    for _ in range(_REFINEMENTS):
        if best.deviation.share <= tolerance:
            break
        at = best.deviation.error, best.deviation.rate
        lines = [_finer(line, x) for line, x in zip(lines, at, strict=True)]
        best = min(
            best,
            _closest(surface, checked, lines, tolerance),
            key=lambda sampling: sampling.deviation.share,
        )
    return best


def _finer(line: Floats, x: float) -> Floats:
    """Return the lines with more of them around ``x``."""
    i = min(max(int(np.searchsorted(line, x)), 1), len(line) - 1)
    low, high = line[max(i - 2, 0)], line[min(i + 1, len(line) - 1)]
    return np.array(sorted({*line.tolist(), *np.linspace(low, high, _MORE + 2).tolist()}))


def _closest(
    surface: Surface, checked: Checked, lines: Sequence[Floats], tolerance: float
) -> Sampling:
    """Return the smallest table within the tolerance whose peaks are among the lines, else the closest."""
    grid = at_peaks(surface, lines[0], lines[1])
    scaled = grid.values / checked.span[:, None, None]
    along = [np.moveaxis(scaled, axis, 0).reshape(len(lines[axis - 1]), -1) for axis in (1, 2)]
    finest = [_finest(line, rows) for line, rows in zip(lines, along, strict=True)]
    samplings: list[Sampling] = []
    for share in _SHARES:
        kept = [
            _chosen(line, rows, max(share * tolerance, least))
            for line, rows, least in zip(lines, along, finest, strict=True)
        ]
        table = Table(lines[0][kept[0]], lines[1][kept[1]], grid.values[:, kept[0]][:, :, kept[1]])
        samplings.append(Sampling(table, checked.deviation(table)))
        if samplings[-1].deviation.share <= tolerance:
            return samplings[-1]
    return min(samplings, key=lambda sampling: sampling.deviation.share)


def _finest(line: Floats, rows: Floats) -> float:
    """Return the smallest tolerance that no more than 64 peaks keep."""
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if len(_chosen(line, rows, middle)) <= MOST:
            high = middle
        else:
            low = middle
    return high


def _chosen(line: Floats, rows: Floats, tolerance: float) -> list[int]:
    """Return the indices of the peaks: from each, the next is the farthest that keeps the tolerance."""
    last = len(line) - 1
    kept = [0]
    while kept[-1] < last:
        start, near = kept[-1], kept[-1] + 1
        far = last + 1
        step = 1
        while near + step <= last and _straight(line, rows, start, near + step, tolerance):
            near, step = near + step, 2 * step
        far = min(near + step, last + 1)
        while far - near > 1:
            middle = (near + far) // 2
            if _straight(line, rows, start, middle, tolerance):
                near = middle
            else:
                far = middle
        kept.append(near)
    return kept


def _straight(line: Floats, rows: Floats, start: int, end: int, tolerance: float) -> bool:
    """Return whether the rows between two indices are within the tolerance of a straight line."""
    weight = (line[start + 1 : end] - line[start]) / (line[end] - line[start])
    between = rows[start] + weight[:, None] * (rows[end] - rows[start])
    return bool(np.all(np.abs(rows[start + 1 : end] - between) <= tolerance))


def _located(values: Floats, peaks: Floats) -> tuple[Indices, Floats]:
    """Return `locate` of many values."""
    clamped = np.clip(values, peaks[0], peaks[-1])
    low = np.clip(np.searchsorted(peaks, clamped, side="right") - 1, 0, len(peaks) - 2)
    return low, (clamped - peaks[low]) / (peaks[low + 1] - peaks[low])
