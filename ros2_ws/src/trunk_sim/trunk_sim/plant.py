"""The plant's state, its accelerations, one step of their integration, and its energy.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

from trunk_msgs_util.elementary import sincos
from trunk_msgs_util.mechanics import Body, forward_dynamics, path_height, path_slope


class PlantState(NamedTuple):
    """Generalised coordinates and their rates: m, rad, m/s, rad/s."""

    x: float
    theta: float
    x_dot: float
    theta_dot: float


def accelerations(
    state: PlantState, hip_force: float, torque: float, body: Body
) -> tuple[float, float]:
    """Return ``(x_ddot, theta_ddot)`` in m/s^2 and rad/s^2, by `forward_dynamics`.

    F [N] acts on the hip along x; tau [N m] is the whole torque on theta (actuator plus disturbance).
    ``body.as_printed`` gives the paper's eq. 12 instead (`accelerations_as_printed`).
    """
    if body.as_printed:
        return accelerations_as_printed(state, hip_force, torque, body)
    x, theta, x_dot, theta_dot = state
    return forward_dynamics(x, theta, x_dot, theta_dot, hip_force, torque, body)


def accelerations_as_printed(
    state: PlantState, hip_force: float, torque: float, body: Body
) -> tuple[float, float]:
    """Return ``(x_ddot, theta_ddot)`` in m/s^2 and rad/s^2 of the paper's eqs. 11 and 12: WRONG PHYSICS.

    Kept to show what they would give. Gravity points up (both signs of G are wrong), so that over a hip at
    rest the upright trunk is stable and needs no controller; the velocity terms enter with the opposite
    sign (+M^-1 V) and one of them is not the Lagrangian's, so that energy is not conserved and a free hip
    still throws the trunk about. ``Z'' = M^-1 (V Z' - G - U)``.

    With Z = [x, theta] and the printed matrices, rows in the printed order (theta's, then x's)::

        M = | m l (cos th - cos x sin th)   m l^2                       |
            | (M+m)(1 + cos^2 x)            m l (cos th - cos x sin th) |
        V = | m l sin x sin th x'           0                                  |
            | -(M+m) sin x cos x x'         -m l (sin th + cos th) cos x th'   |
        G = | m g l sin th | -(M+m) g cos x |,     U = | -tau | -F |

    The torque enters as -U with U = -tau: the paper's negative gains in its eq. 12 are our positive
    ones. F [N] acts on the hip. The path is ``y = sin x``, whatever ``body``
    contains. NaN if an angle is beyond `LARGEST_ANGLE`, or the motion too large for floats.
    """
    x, theta, x_dot, theta_dot = state
    sin_x, cos_x = sincos(x)
    sin_theta, cos_theta = sincos(theta)
    mass = body.hip_mass + body.trunk_mass
    moment = body.trunk_mass * body.length
    m11 = moment * (cos_theta - cos_x * sin_theta)
    m12 = moment * body.length
    m21 = mass * (1.0 + cos_x * cos_x)
    v11 = moment * sin_x * sin_theta * x_dot
    v21 = -mass * sin_x * cos_x * x_dot
    v22 = -moment * (sin_theta + cos_theta) * cos_x * theta_dot
    r1 = v11 * x_dot - moment * body.gravity * sin_theta + torque
    r2 = v21 * x_dot + v22 * theta_dot + mass * body.gravity * cos_x + hip_force
    determinant = m11 * m11 - m12 * m21  # negative: the printed rows are those of M, swapped
    if determinant == 0.0:  # underflow
        return nan, nan
    return (m11 * r1 - m12 * r2) / determinant, (m11 * r2 - m21 * r1) / determinant


def rk4_step(
    state: PlantState, hip_force: float, torque: float, h: float, body: Body
) -> PlantState:
    """Return the state after one step of ``h`` seconds, the inputs [N, N m] held over it.

    The classical Runge-Kutta method of order 4: local error O(h^5), global O(h^4).
    """
    x, theta, v, w = state
    half = 0.5 * h
    a1, b1 = accelerations(state, hip_force, torque, body)
    v2, w2 = v + half * a1, w + half * b1
    a2, b2 = accelerations(
        PlantState(x + half * v, theta + half * w, v2, w2), hip_force, torque, body
    )
    v3, w3 = v + half * a2, w + half * b2
    a3, b3 = accelerations(
        PlantState(x + half * v2, theta + half * w2, v3, w3), hip_force, torque, body
    )
    v4, w4 = v + h * a3, w + h * b3
    a4, b4 = accelerations(PlantState(x + h * v3, theta + h * w3, v4, w4), hip_force, torque, body)
    sixth = h / 6.0
    return PlantState(
        x + sixth * (v + 2.0 * (v2 + v3) + v4),
        theta + sixth * (w + 2.0 * (w2 + w3) + w4),
        v + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        w + sixth * (b1 + 2.0 * (b2 + b3) + b4),
    )


def advance(
    state: PlantState,
    hip_force: float,
    torque: float,
    period: float,
    substeps: int,
    body: Body,
) -> PlantState:
    """Return the state after one control period, integrated in ``substeps`` equal RK4 steps."""
    h = period / substeps
    for _ in range(substeps):
        state = rk4_step(state, hip_force, torque, h, body)
    return state


def energy(state: PlantState, body: Body) -> float:
    """Return the mechanical energy T + V in J (paper, eqs. 5 and 6), conserved while every input is zero.

    ::

        T = M/2 (x'^2 + y_dot^2) + m/2 ((x' + l th' cos th)^2 + (y_dot - l th' sin th)^2),  y_dot = y' x'
        V = M g y + m g (y + l cos th)
    """
    x, theta, x_dot, theta_dot = state
    y = path_height(x, body.amplitude, body.wavenumber, body.harmonics)
    y_dot = path_slope(x, body.amplitude, body.wavenumber, body.harmonics) * x_dot
    sin_theta, cos_theta = sincos(theta)
    com_x_dot = x_dot + body.length * theta_dot * cos_theta
    com_y_dot = y_dot - body.length * theta_dot * sin_theta
    kinetic = 0.5 * body.hip_mass * (x_dot * x_dot + y_dot * y_dot) + 0.5 * body.trunk_mass * (
        com_x_dot * com_x_dot + com_y_dot * com_y_dot
    )
    potential = body.gravity * (body.hip_mass * y + body.trunk_mass * (y + body.length * cos_theta))
    return kinetic + potential
