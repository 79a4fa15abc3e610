"""What a law obeys whatever its gains: derivative mode, filter, limits and anti-windup.

Pure: scalar functions of floats and a named tuple, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

DERIVATIVE_ON_ERROR = 0  # D = (e_k - e_{k-1}) / h: the paper's eq. 13, kicks on reference steps
DERIVATIVE_ON_MEASUREMENT = 1  # D = -(y_k - y_{k-1}) / h
DERIVATIVE_FROM_RATE = 2  # D = -(measured rate): a gyro

ANTIWINDUP_NONE = 0
ANTIWINDUP_CONDITIONAL_INTEGRATION = 1
ANTIWINDUP_BACK_CALCULATION = 2


class Limits(NamedTuple):
    """What stays fixed while the gains change: modes, filter and limits.

    ``tracking_time_constant`` [s] is used by back-calculation, at least dt; 0 means sqrt(kd / ki)
    (= sqrt(Ti Td)), and kp / ki (= Ti) where kd is 0.
    """

    derivative: int = DERIVATIVE_ON_ERROR
    filter_time: float = 0.0  # s; 0: no filter
    u_min: float = -inf  # N m
    u_max: float = inf  # N m
    i_min: float = -inf  # N m, limits of the integral term
    i_max: float = inf  # N m
    antiwindup: int = ANTIWINDUP_NONE
    tracking_time_constant: float = 0.0  # s


def limited(effort: float, limits: Limits) -> float:
    """Return a command in N m, limited to [u_min, u_max]."""
    if effort > limits.u_max:
        return limits.u_max
    return limits.u_min if effort < limits.u_min else effort
