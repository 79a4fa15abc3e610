"""The sums from which a run's metrics are computed, added up row by row.

Pure: functions of floats and named tuples, which CPython runs and numba compiles unchanged. All rows
are added in their order, so that a recording, a run in compiled code and one among many in lanes give
the same bits.
"""

from __future__ import annotations

from math import inf, nan, radians
from typing import NamedTuple

SETTLING_BAND_DEG = 6.0
SETTLING_BAND = radians(SETTLING_BAND_DEG)  # rad


class Sums(NamedTuple):
    """Sums and extremes of the rows so far, with what the next row needs from the last."""

    t: float  # s
    error: float  # reference - theta, rad
    torque: float  # N m
    iae: float  # twice the integral, as the next two
    ise: float
    itae: float
    effort: float  # N^2 m^2 s
    peak_torque: float  # N m
    lowest: float  # rad
    highest: float  # rad
    level: float  # rad, the reference's
    level_since: float  # s
    level_from: float  # rad, the angle when the level began
    level_lowest: float  # rad, since then
    level_highest: float  # rad
    settled_at: float  # s, since when the error has been in the band; infinite outside
    steady_rows: float  # those in the steady state
    steady_sum: float  # of their errors, rad
    steady_squares: float  # rad^2


def _greater(a: float, b: float) -> float:
    return b if b > a else a


def _smaller(a: float, b: float) -> float:
    return b if b < a else a


def no_rows(t: float) -> Sums:
    """Return the sums before the first row, which is at t [s]."""
    return Sums(
        t,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        inf,
        -inf,
        nan,
        t,
        0.0,
        inf,
        -inf,
        inf,
        0.0,
        0.0,
        0.0,
    )


def with_row(
    s: Sums, t: float, theta: float, reference: float, torque: float, steady_from: float
) -> Sums:
    """Return the sums with one more row; from t = ``steady_from`` on it counts for the steady state.

    Integrals use the trapezoidal rule; for the effort, a torque is held until the next row.
    """
    step = t - s.t
    error = reference - theta
    size, before = abs(error), abs(s.error)
    level, since, started = s.level, s.level_since, s.level_from
    low, high, settled_at = s.level_lowest, s.level_highest, s.settled_at
    if reference != level:
        level, since, started = reference, t, theta
        low, high, settled_at = inf, -inf, inf
    if size > SETTLING_BAND:
        settled_at = inf
    elif settled_at == inf:
        settled_at = t
    steady = 1.0 if t >= steady_from else 0.0
    return Sums(
        t,
        error,
        torque,
        s.iae + step * (size + before),
        s.ise + step * (error * error + s.error * s.error),
        s.itae + step * (t * size + s.t * before),
        s.effort + step * (s.torque * s.torque),
        _greater(s.peak_torque, abs(torque)),
        _smaller(s.lowest, theta),
        _greater(s.highest, theta),
        level,
        since,
        started,
        _smaller(low, theta),
        _greater(high, theta),
        settled_at,
        s.steady_rows + steady,
        s.steady_sum + (error if steady == 1.0 else 0.0),
        s.steady_squares + (error * error if steady == 1.0 else 0.0),
    )
