"""LQR with integral action: state feedback on the trunk's error, plus the torque that holds the reference.

Its structure is that of a PID with feed-forward; only the origin of the gains differs. With the hip's
motion prescribed and the trunk upright, the plant is ``m l^2 theta'' = m g l theta + tau``; the gains
minimise ``integral (I^2 / I_0^2 + e^2 / e_0^2 + e'^2 / w_0^2 + u^2 / u_0^2) dt`` for its states I, e, e'.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from trunk_msgs_util.elementary import sin

from .pid import Gains, PidLaw, PidState, Terms, alpha_of, combine, error_derivative, held, usable


def lqr_update(
    state: PidState,
    reference: float,
    measurement: float,
    rate: float,
    dt: float,
    gains: Gains,
    gravity_torque: float,
    law: PidLaw,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = kp e + ki I + kd D - G sin(reference)``.

    ``gravity_torque`` G = m g l in N m: gravity's torque on a level trunk. The feed-forward is the
    command minus the three terms. Holds as `pid_update` does.
    """
    error = reference - measurement
    if not usable(error, rate, dt):
        return held(state, gains, alpha_of(gains), law)
    derivative = error_derivative(state, error, measurement, rate, dt, law)
    return combine(
        state,
        error,
        measurement,
        derivative,
        dt,
        gains,
        alpha_of(gains),
        law,
        -gravity_torque * sin(reference),
    )
