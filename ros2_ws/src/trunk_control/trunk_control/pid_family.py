"""What PID-like laws share: state, terms, one update, and bumpless transfer through the integral.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
Names follow ros-controls' control_toolbox where it has one.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, NamedTuple

from trunk_core.parameters.declarations import parameter

from .law import (
    ANTIWINDUP_BACK_CALCULATION,
    ANTIWINDUP_CONDITIONAL_INTEGRATION,
    DERIVATIVE_FROM_RATE,
    DERIVATIVE_ON_MEASUREMENT,
    BumplessTransfer,
    Constants,
    ControllerConfig,
    Law,
    Limits,
    Lookup,
    Reconfigure,
    Sample,
    Update,
    limited,
)

UNITS = {
    "error": "rad",
    "error_rate": "rad/s",
    "p_term": "N m",
    "i_term": "N m",
    "d_term": "N m",
    "kp": "N m/rad",
    "ki": "N m/(rad s)",
    "kd": "N m s/rad",
    "alpha": "",  # a ratio
    "unsaturated": "N m",
    "effort": "N m",
}


class Gains(NamedTuple):
    """Parallel gains: N m/rad, N m/(rad s), N m s/rad. Positive for e = r - y."""

    p: float
    i: float
    d: float


def gain(name: str, default: float, description: str, unit: str) -> Any:
    """Return the declaration of the gain ``gains.NAME``."""
    name = f"gains.{name}"
    return parameter(name, default, description, unit=unit, minimum=0.0, maximum=1e9)


class WithGains:
    """What configurations with the gains p, i and d have in common."""

    p: float
    i: float
    d: float

    @property
    def gains(self) -> Gains:
        """The gains."""
        return Gains(self.p, self.i, self.d)

    @property
    def damping_gain(self) -> float:
        """Kd."""
        return self.d


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
    state: PidState, error: float, measurement: float, rate: float, dt: float, limits: Limits
) -> float:
    """Return the error's derivative in rad/s, by the law's mode and filter.

    ::

        D_k = (e_k - e_{k-1}) / h  |  -(y_k - y_{k-1}) / h  |  -rate,      e_{-1} = e_0, y_{-1} = y_0
        F_k = F_{k-1} + h / (T_f + h) (D_k - F_{k-1}),                     F_{-1} = 0, where T_f > 0
    """
    if limits.derivative == DERIVATIVE_FROM_RATE:
        derivative = -rate
    elif not state.started:
        derivative = 0.0
    elif limits.derivative == DERIVATIVE_ON_MEASUREMENT:
        derivative = (state.measurement - measurement) / dt
    else:
        derivative = (error - state.error) / dt
    if limits.filter_time > 0.0:
        previous = state.derivative
        derivative = previous + dt / (limits.filter_time + dt) * (derivative - previous)
    return derivative


def integral_kept(
    integral: float,
    before: float,
    error: float,
    u: float,
    effort: float,
    dt: float,
    gains: Gains,
    limits: Limits,
) -> float:
    """Return the integral for the next sample: anti-windup, where the command u was limited to ``effort``.

    ``before``: the integral at the last sample; ``error`` e: what is integrated. Conditional integration
    returns ``before`` where ``u e > 0``; back-calculation adds ``h (u_limited - u) / (T_t ki)``, where
    T_t = 0 means sqrt(kd / ki), or kp / ki without kd; T_t is at least h.
    """
    if effort != u:
        if limits.antiwindup == ANTIWINDUP_CONDITIONAL_INTEGRATION:
            if u * error > 0.0:
                return before
        elif limits.antiwindup == ANTIWINDUP_BACK_CALCULATION and gains.i > 0.0:
            tracking = limits.tracking_time_constant
            if tracking <= 0.0:
                tracking = sqrt(gains.d / gains.i) if gains.d > 0.0 else gains.p / gains.i
            if tracking < dt:
                tracking = dt  # faster would overshoot the limit, and diverge below dt / 2
            scale = tracking * gains.i
            if scale > 0.0:  # it may underflow to 0
                return integral + dt * (effort - u) / scale
    return integral


def error_inputs(state: PidState, sample: Sample, limits: Limits) -> tuple[float, float]:
    """Return the error and its derivative, the inputs of rules, in rad and rad/s."""
    error = sample.reference - sample.measurement
    rate = error_derivative(state, error, sample.measurement, sample.rate, sample.dt, limits)
    return error, rate


def combine(
    state: PidState,
    error: float,
    measurement: float,
    derivative: float,
    dt: float,
    gains: Gains,
    alpha: float,
    limits: Limits,
    feedforward: float,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = kp e + ki I + kd D + f``, limited to [u_min, u_max].

    ``feedforward`` f [N m] is a model's part, added to the feedback; 0 in a PID. ``I_k = I_{k-1} + h e_k``
    is used at once. Anti-windup acts afterwards, on the I of the next sample (`integral_kept`). Ki stands
    outside the sum, so that gains may change freely.
    If an overflow would make the command or the state non-finite, the last command is held.
    """
    kp, ki, kd = gains
    integral = state.integral + dt * error
    p_term = kp * error
    i_term = ki * integral
    if i_term > limits.i_max:
        i_term = limits.i_max
        if ki != 0.0:
            integral = i_term / ki
    elif i_term < limits.i_min:
        i_term = limits.i_min
        if ki != 0.0:
            integral = i_term / ki
    d_term = kd * derivative
    u = p_term + i_term + d_term + feedforward
    effort = limited(u, limits)
    integral = integral_kept(integral, state.integral, error, u, effort, dt, gains, limits)
    total = effort + integral + derivative
    if total - total != 0.0:
        return held(state, gains, alpha, limits)
    return (
        PidState(integral, error, measurement, derivative, effort, True),
        Terms(error, derivative, p_term, i_term, d_term, kp, ki, kd, alpha, u, effort, False),
    )


def alpha_of(gains: Gains) -> float:
    """Return alpha = kp^2 / (ki kd) (paper, eq. 14), or 0 where a gain is zero."""
    product = gains.i * gains.d
    return gains.p * gains.p / product if product > 0.0 else 0.0


def held(state: PidState, gains: Gains, alpha: float, limits: Limits) -> tuple[PidState, Terms]:
    """Return the unchanged state, and terms that repeat the last command within the current limits."""
    effort = limited(state.effort, limits)
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


def rescaled(state: PidState, old: Gains, new: Gains) -> PidState:
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


GainsOf = Callable[[PidState, Sample, Constants], Gains]


def law_of_pid_family(
    name: str,
    label: str,
    config: type[ControllerConfig],
    update: Update,
    gains: GainsOf,
    describe: Callable[[Any], str] | None = None,
    lookup: Lookup | None = None,
    plant: str = "",
) -> Law:
    """Return a law whose memory is `PidState` and whose terms are `Terms`.

    ``gains(memory, sample, constants)`` returns the gains at the last update and its sample.
    """
    return Law(
        name,
        label,
        config,
        update,
        PidState(),
        Terms,
        UNITS,
        transfer_by_integral(update),
        reconfigure_by_integral(gains),
        describe,
        lookup,
        plant,
    )


def constant_gains(memory: PidState, sample: Sample, constants: Constants) -> Gains:
    """Return the gains of a law that has them as its first constant, whatever its memory."""
    gains: Gains = constants[0]
    return gains


def transfer_by_integral(update: Update) -> BumplessTransfer:
    """Return the function that makes a law's command continue from the torque that acts.

    ``I = (u - u|I=0) / ki``. The derivative starts from the last state seen, so that it contains no
    jump of the reference. What the integral cannot absorb (ki = 0, its limits), the command makes up
    in bounded steps.
    """

    def transfer(
        initial: PidState,
        seen: float,
        sample: Sample,
        effort: float,
        constants: Constants,
        limits: Limits,
    ) -> PidState:
        memory = PidState(0.0, sample.reference - seen, seen, 0.0, effort, True)
        _, terms = update(memory, sample, constants, limits)
        if terms.ki > 0.0:
            integral = (effort - terms.unsaturated) / terms.ki
            if integral - integral == 0.0:
                memory = PidState(integral, memory.error, seen, 0.0, effort, True)
        return memory

    return transfer


def reconfigure_by_integral(gains: GainsOf) -> Reconfigure:
    """Return the function that rescales the integral as `rescaled` does."""

    def reconfigure(
        memory: PidState, sample: Sample, before: Constants, after: Constants
    ) -> PidState:
        return rescaled(memory, gains(memory, sample, before), gains(memory, sample, after))

    return reconfigure
