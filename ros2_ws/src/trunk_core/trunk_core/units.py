"""Time as integer nanoseconds, so that step k is stamped k times the period and nothing drifts.

Pure: scalar functions of integers, floats and tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence

NANOSECONDS = 1_000_000_000
LAST_STAMP_NS = 2**31 * NANOSECONDS - 1  # the largest that a ROS message can carry


def nanoseconds(seconds: float) -> int:
    """Return a time in s as integer nanoseconds, to the nearest."""
    return round(seconds * NANOSECONDS)


def seconds(stamp_ns: int) -> float:
    """Return a stamp in ns as s, correctly rounded (by division: 1e-9 is not a double)."""
    return stamp_ns / NANOSECONDS


def period_ns(rate: float) -> int:
    """Return the period of a rate in Hz as integer nanoseconds, to the nearest.

    Every duration in the project is a multiple of it, so 60 Hz runs at 1e9 / 16666667 Hz, exactly.
    """
    return round(NANOSECONDS / rate)


def step_count(duration: float, rate: float) -> int:
    """Return the number of steps nearest to ``duration`` s at ``rate`` Hz."""
    return round(nanoseconds(duration) / period_ns(rate))


def latest(t_ns: int, times: Sequence[int]) -> int:
    """Return the index of the last time at or before a stamp, -1 before the first; all in ns.

    The times ascend; of equal ones the last counts. By bisection: log2 of their number of comparisons.
    """
    low, high = 0, len(times)
    while low < high:
        middle = (low + high) // 2
        if times[middle] <= t_ns:
            low = middle + 1
        else:
            high = middle
    return low - 1


def held(t_ns: int, times: Sequence[int], values: Sequence[float], before: float) -> float:
    """Return ``values[i]`` from ``times[i]`` on, ``before`` until the first."""
    i = latest(t_ns, times)
    return values[i] if i >= 0 else before


def interpolated(t_ns: int, times: Sequence[int], values: Sequence[float], before: float) -> float:
    """Return the value at a stamp in ns, linear between the rows (t_i, v_i), in the values' unit.

    ::

        before                                                 t < t_0
        v_i + (v_(i+1) - v_i) ((t - t_i) / (t_(i+1) - t_i))    t_i <= t < t_(i+1)
        v_n                                                    t_n <= t, the last row

    Evaluated as the brackets say: the two differences of stamps are exact integers (below 2^53 ns, 104
    days, exact as doubles too), then one division, one difference of values, one product, one sum, each
    rounded once. At a row it is that row's value; two rows of the same time make a jump.
    """
    i = latest(t_ns, times)
    if i < 0:
        return before
    if i == len(times) - 1:
        return values[i]
    share = (t_ns - times[i]) / (times[i + 1] - times[i])
    return values[i] + (values[i + 1] - values[i]) * share
