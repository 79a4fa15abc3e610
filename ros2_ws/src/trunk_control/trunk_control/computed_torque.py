"""Computed torque: the inverse dynamics of a model turn a wanted angular acceleration into a torque.

The model is the controller's own: its constants may be wrong, as a robot's are.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import cos, nan, sin
from typing import NamedTuple

from .pid import Gains, PidLaw, PidState, Terms, alpha_of, combine, error_derivative, held, usable


class Hip(NamedTuple):
    """The hip as measured: m, m/s."""

    position: float = 0.0
    velocity: float = 0.0


class Model(NamedTuple):
    """What the controller believes of the plant (SI units)."""

    hip_mass: float = 2.0
    trunk_mass: float = 0.5
    length: float = 1.0
    gravity: float = 9.81
    amplitude: float = 1.0
    wavenumber: float = 1.0
    prescribed: bool = False


def inverse_dynamics(hip: Hip, theta: float, theta_dot: float, model: Model) -> tuple[float, float]:
    """Return ``(H, c)`` [kg m^2, N m] of ``tau = H theta'' + c``, the hip's own motion eliminated.

    With y', y'' the slope and curvature of the path, ``n = sin th + y' cos th``,
    ``a = cos th - y' sin th`` and ``mu = m l a / ((M + m)(1 + y'^2))``::

        H = m l^2 (M (1 + y'^2) + m n^2) / ((M + m)(1 + y'^2))
        c = mu (m l n th'^2 - (M + m) y' (y'' x'^2 + g)) - m l sin th (y'' x'^2 + g)

    A prescribed hip leaves ``H = m l^2`` and the last term of c. Both are NaN where an angle is too large
    to be a float.
    """
    phase = model.wavenumber * hip.position
    angles = phase + theta
    if angles - angles != 0.0:  # CPython raises for the sine of infinity
        return nan, nan
    slope = model.amplitude * model.wavenumber * cos(phase)
    curvature = -model.amplitude * model.wavenumber * model.wavenumber * sin(phase)
    sin_theta = sin(theta)
    cos_theta = cos(theta)
    moment = model.trunk_mass * model.length
    fall = curvature * hip.velocity * hip.velocity + model.gravity
    own = moment * sin_theta * fall
    if model.prescribed:
        return moment * model.length, -own
    mass = model.hip_mass + model.trunk_mass
    stretch = 1.0 + slope * slope
    normal = sin_theta + slope * cos_theta
    share = moment * (cos_theta - slope * sin_theta) / (mass * stretch)
    inertia = (
        moment
        * model.length
        * (model.hip_mass * stretch + model.trunk_mass * normal * normal)
        / (mass * stretch)
    )
    return inertia, share * (moment * normal * theta_dot * theta_dot - mass * slope * fall) - own


def computed_torque_update(
    state: PidState,
    reference: float,
    measurement: float,
    rate: float,
    dt: float,
    hip: Hip,
    gains: Gains,
    model: Model,
    law: PidLaw,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = H (kp e + ki I + kd D) + c``.

    ``gains`` are accelerations: 1/s^2, 1/s^3, 1/s; with an exact model the error then obeys
    ``e'' + kd e' + kp e + ki I = 0``. The terms carry the gains times H. ``rate`` [rad/s] is used by
    the model in every derivative mode. Holds and raises as `pid_update` does.
    """
    error = reference - measurement
    if not usable(error, rate + hip.position + hip.velocity, dt):
        return held(state, gains, alpha_of(gains), law)
    inertia, bias = inverse_dynamics(hip, measurement, rate, model)
    effective = Gains(inertia * gains.p, inertia * gains.i, inertia * gains.d)
    alpha = alpha_of(effective)
    if not usable(error, bias, dt):  # the squares of finite rates may overflow
        return held(state, effective, alpha, law)
    derivative = error_derivative(state, error, measurement, rate, dt, law)
    return combine(state, error, measurement, derivative, dt, effective, alpha, law, bias)
