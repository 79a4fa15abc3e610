"""The plant's state, its accelerations and its energy.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from typing import NamedTuple

from trunk_msgs_util.elementary import sincos
from trunk_msgs_util.mechanics import Body, forward_dynamics, path_height, path_slope

from .plant_as_printed import accelerations_as_printed


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
