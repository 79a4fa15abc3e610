"""Computed torque: a model's inverse dynamics turns a desired angular acceleration into a torque.

The model belongs to the controller: its constants may be wrong, as on a real robot.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from typing import NamedTuple

from trunk_msgs_util.mechanics import Body, inverse_dynamics

from .pid import Gains, PidLaw, PidState, Terms, alpha_of, combine, error_derivative, held, usable


class Hip(NamedTuple):
    """The hip as measured: m, m/s."""

    position: float = 0.0
    velocity: float = 0.0


def computed_torque_update(
    state: PidState,
    reference: float,
    measurement: float,
    rate: float,
    dt: float,
    hip: Hip,
    gains: Gains,
    model: Body,
    law: PidLaw,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = H (kp e + ki I + kd D) + c``.

    ``gains`` give accelerations: 1/s^2, 1/s^3, 1/s; with an exact model the error then obeys
    ``e'' + kd e' + kp e + ki I = 0``. The terms carry the gains times H. The model uses ``rate``
    [rad/s] in every derivative mode. Holds the last command as `pid_update` does.
    """
    error = reference - measurement
    if not usable(error, rate + hip.position + hip.velocity, dt):
        return held(state, gains, alpha_of(gains), law)
    inertia, bias = inverse_dynamics(hip.position, measurement, hip.velocity, rate, model)
    effective = Gains(inertia * gains.p, inertia * gains.i, inertia * gains.d)
    alpha = alpha_of(effective)
    if not usable(error, bias, dt):  # the squares of finite rates may overflow
        return held(state, effective, alpha, law)
    derivative = error_derivative(state, error, measurement, rate, dt, law)
    return combine(state, error, measurement, derivative, dt, effective, alpha, law, bias)
