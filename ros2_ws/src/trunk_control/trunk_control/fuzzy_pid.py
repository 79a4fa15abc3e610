"""Fuzzy-PID: a PID whose gains are inferred at each sample from (e, e_dot).

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from .fuzzy import FuzzyRules, infer
from .pid import Gains, PidLaw, PidState, Terms, combine, error_derivative, held, usable


class GainBox(NamedTuple):
    """Ranges of the inferred gains: [0.32, 0.60] Ku and [0.08, 0.15] Ku Tu (paper, eq. 16, corrected)."""

    p_min: float = 32.0  # N m/rad
    p_max: float = 60.0  # N m/rad
    d_min: float = 9.6  # N m s/rad
    d_max: float = 18.0  # N m s/rad


def inferred_gains(
    error: float, error_rate: float, rules: FuzzyRules, box: GainBox
) -> tuple[Gains, float]:
    """Return ``(gains, alpha)`` at the inputs [rad, rad/s] (paper, eqs. 14 to 16).

    ::

        Kp = Kp,min + (Kp,max - Kp,min) Kp'      Kd likewise      Ki = Kp^2 / (alpha Kd)

    Kp and Kd never leave the box, not even by rounding.
    """
    kp_scaled, kd_scaled, alpha = infer(error, error_rate, rules)
    kp = box.p_min + (box.p_max - box.p_min) * kp_scaled
    kd = box.d_min + (box.d_max - box.d_min) * kd_scaled
    if kp > box.p_max:
        kp = box.p_max
    elif kp < box.p_min:
        kp = box.p_min
    if kd > box.d_max:
        kd = box.d_max
    elif kd < box.d_min:
        kd = box.d_min
    scale = alpha * kd
    ki = kp * kp / scale if scale != 0.0 else inf  # it may underflow to 0
    return Gains(kp, ki, kd), alpha


def fuzzy_pid_update(
    state: PidState,
    reference: float,
    measurement: float,
    rate: float,
    dt: float,
    rules: FuzzyRules,
    box: GainBox,
    law: PidLaw,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of one Fuzzy-PID update.

    The gains are inferred at (e_k, D_k), with the derivative that the law uses, and applied to the same
    sample: ``u = Kp e + Ki I + Kd D`` with Ki outside the sum. Holds as `pid_update` does.
    """
    error = reference - measurement
    if not usable(error, rate, dt):
        gains, alpha = inferred_gains(state.error, state.derivative, rules, box)
        return held(state, gains, alpha, law)
    derivative = error_derivative(state, error, measurement, rate, dt, law)
    gains, alpha = inferred_gains(error, derivative, rules, box)
    return combine(state, error, measurement, derivative, dt, gains, alpha, law, 0.0)
