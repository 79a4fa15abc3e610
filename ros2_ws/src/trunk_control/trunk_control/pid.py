"""The sampled PID law: three derivative modes, filter, limits, anti-windup, reset, bumpless retuning.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
Names follow ros-controls' control_toolbox where it has one.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

DERIVATIVE_ON_ERROR = 0  # D = (e_k - e_{k-1}) / h: the paper's eq. 13, kicks on reference steps
DERIVATIVE_ON_MEASUREMENT = 1  # D = -(y_k - y_{k-1}) / h
DERIVATIVE_FROM_RATE = 2  # D = -(measured rate): a gyro

ANTIWINDUP_NONE = 0
ANTIWINDUP_CONDITIONAL_INTEGRATION = 1
ANTIWINDUP_BACK_CALCULATION = 2


class Gains(NamedTuple):
    """Parallel gains: N m/rad, N m/(rad s), N m s/rad. Positive for e = r - y."""

    p: float
    i: float
    d: float


class PidLaw(NamedTuple):
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


class PidState(NamedTuple):
    """Memory between samples; the default value is the state after a reset."""

    integral: float = 0.0  # I_k, rad s
    error: float = 0.0  # e_k, rad
    measurement: float = 0.0  # y_k, rad
    derivative: float = 0.0  # D_k, or F_k with a filter, rad/s
    effort: float = 0.0  # the last command, N m
    started: bool = False  # False: there is no previous sample


class Terms(NamedTuple):
    """One update, term by term: what a controller publishes on ``~/state``."""

    error: float  # rad
    error_rate: float  # the derivative that was used, rad/s
    p_term: float  # N m
    i_term: float  # N m
    d_term: float  # N m
    kp: float
    ki: float
    kd: float
    alpha: float  # kp^2 / (ki kd); 0 if undefined
    unsaturated: float  # N m
    effort: float  # N m, after the limits
    held: bool  # True: input or output not finite; state and command stay as they were


def error_derivative(
    state: PidState, error: float, measurement: float, rate: float, dt: float, law: PidLaw
) -> float:
    """Return the error's derivative in rad/s, by the law's mode and filter.

    ::

        D_k = (e_k - e_{k-1}) / h  |  -(y_k - y_{k-1}) / h  |  -rate,      e_{-1} = e_0, y_{-1} = y_0
        F_k = F_{k-1} + h / (T_f + h) (D_k - F_{k-1}),                     F_{-1} = 0, where T_f > 0
    """
    if law.derivative == DERIVATIVE_FROM_RATE:
        derivative = -rate
    elif not state.started:
        derivative = 0.0
    elif law.derivative == DERIVATIVE_ON_MEASUREMENT:
        derivative = (state.measurement - measurement) / dt
    else:
        derivative = (error - state.error) / dt
    if law.filter_time > 0.0:
        previous = state.derivative
        derivative = previous + dt / (law.filter_time + dt) * (derivative - previous)
    return derivative


def combine(
    state: PidState,
    error: float,
    measurement: float,
    derivative: float,
    dt: float,
    gains: Gains,
    alpha: float,
    law: PidLaw,
    feedforward: float,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = kp e + ki I + kd D + f``, limited to [u_min, u_max].

    ``feedforward`` f [N m] is a model's part, added to the feedback; 0 in a PID. ``I_k = I_{k-1} + h e_k``
    is used at once. Anti-windup acts afterwards, on the I of the next sample: conditional integration
    drops the increment where u is limited and ``u e > 0``; back-calculation adds
    ``h (u_limited - u) / (T_t ki)``. Ki stands outside the sum, so that gains may change freely.
    If an overflow would make the command or the state non-finite, the last command is held.
    """
    kp, ki, kd = gains
    integral = state.integral + dt * error
    p_term = kp * error
    i_term = ki * integral
    if i_term > law.i_max:
        i_term = law.i_max
        if ki != 0.0:
            integral = i_term / ki
    elif i_term < law.i_min:
        i_term = law.i_min
        if ki != 0.0:
            integral = i_term / ki
    d_term = kd * derivative
    u = p_term + i_term + d_term + feedforward
    effort = u
    if u > law.u_max:
        effort = law.u_max
    elif u < law.u_min:
        effort = law.u_min
    if effort != u:
        if law.antiwindup == ANTIWINDUP_CONDITIONAL_INTEGRATION:
            if u * error > 0.0:
                integral = state.integral
        elif law.antiwindup == ANTIWINDUP_BACK_CALCULATION and ki > 0.0:
            tracking = law.tracking_time_constant
            if tracking <= 0.0:
                tracking = sqrt(kd / ki) if kd > 0.0 else kp / ki
            if tracking < dt:
                tracking = dt  # faster would overshoot the limit, and diverge below dt / 2
            scale = tracking * ki
            if scale > 0.0:  # it may underflow to 0
                integral += dt * (effort - u) / scale
    total = effort + integral + derivative
    if total - total != 0.0:
        return held(state, gains, alpha, law)
    return (
        PidState(integral, error, measurement, derivative, effort, True),
        Terms(error, derivative, p_term, i_term, d_term, kp, ki, kd, alpha, u, effort, False),
    )


def alpha_of(gains: Gains) -> float:
    """Return alpha = kp^2 / (ki kd) (paper, eq. 14), or 0 where a gain is zero."""
    product = gains.i * gains.d
    return gains.p * gains.p / product if product > 0.0 else 0.0


def limited(effort: float, law: PidLaw) -> float:
    """Return a command in N m, limited to [u_min, u_max]."""
    if effort > law.u_max:
        return law.u_max
    return law.u_min if effort < law.u_min else effort


def held(state: PidState, gains: Gains, alpha: float, law: PidLaw) -> tuple[PidState, Terms]:
    """Return the unchanged state, and terms that repeat the last command within the current limits."""
    effort = limited(state.effort, law)
    return state, Terms(
        state.error,
        state.derivative,
        0.0,
        0.0,
        0.0,
        gains.p,
        gains.i,
        gains.d,
        alpha,
        state.effort,
        effort,
        True,
    )


def usable(error: float, rate: float, dt: float) -> bool:
    """Return True if the sample may change the state: finite error and rate, and time has advanced."""
    total = error + rate
    return dt > 0.0 and total - total == 0.0


def pid_update(
    state: PidState,
    reference: float,
    measurement: float,
    rate: float,
    dt: float,
    gains: Gains,
    law: PidLaw,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of one PID update (paper, eq. 13).

    ``reference`` and ``measurement`` in rad, ``rate`` (measured, used only by mode "rate") in rad/s,
    ``dt`` in s since the previous update. ``dt <= 0``, a non-finite sample, or a law whose result would
    not be finite holds the last command and leaves the state unchanged.
    """
    error = reference - measurement
    if not usable(error, rate, dt):
        return held(state, gains, alpha_of(gains), law)
    derivative = error_derivative(state, error, measurement, rate, dt, law)
    return combine(state, error, measurement, derivative, dt, gains, alpha_of(gains), law, 0.0)


def retune(state: PidState, old: Gains, new: Gains) -> PidState:
    """Return the state with its integral rescaled so that a change of gains does not move the command.

    ``I' = (u_old - kp' e - kd' D) / ki'`` with the last e and D; where ``ki' = 0``, or so small that I'
    would not be finite, the integral is kept and the command jumps by the change of the other terms.
    """
    if not state.started or new.i == 0.0 or old == new:
        return state
    u = old.p * state.error + old.i * state.integral + old.d * state.derivative
    integral = (u - new.p * state.error - new.d * state.derivative) / new.i
    if integral - integral != 0.0:
        return state
    return PidState(
        integral, state.error, state.measurement, state.derivative, state.effort, state.started
    )
