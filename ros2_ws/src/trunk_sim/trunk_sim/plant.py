"""Equations of motion of the trunk as an inverted pendulum whose hip rides a sinusoidal path.

The hip (mass M) is at ``(x, y)`` with ``y = A sin(k x)``; the trunk's centre of mass (mass m) is at
``(x + l sin theta, y + l cos theta)``, theta measured from the upward vertical, forward lean positive.
Derived from the Lagrangian of the paper (its eq. 7); every misprint of its eqs. 8-12 is corrected.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from .plant_as_printed import accelerations_as_printed


class PlantParameters(NamedTuple):
    """Constants of the plant (SI units); the defaults are the paper's Table 5 where it prints one."""

    hip_mass: float = 2.0  # M, kg
    trunk_mass: float = 0.5  # m, kg
    length: float = 1.0  # l, m, hip to centre of mass
    gravity: float = 9.81  # g, m/s^2
    amplitude: float = 1.0  # A, m
    wavenumber: float = 1.0  # k, rad/m
    prescribed: bool = False  # True: the hip keeps its horizontal speed whatever the trunk does
    as_printed: bool = False  # True: the paper's misprinted equations, which are wrong physics


class PlantState(NamedTuple):
    """Generalised coordinates and their rates: m, rad, m/s, rad/s."""

    x: float
    theta: float
    x_dot: float
    theta_dot: float


def accelerations(
    state: PlantState, hip_force: float, torque: float, p: PlantParameters
) -> tuple[float, float]:
    """Return ``(x_ddot, theta_ddot)`` in m/s^2 and rad/s^2.

    With ``y' = A k cos(k x)`` and ``y'' = -A k^2 sin(k x)``::

        a11 x'' + a12 theta'' = -(M+m) y' y'' x'^2 + m l (sin th + y' cos th) th'^2 - (M+m) g y' + F
        a12 x'' + a22 theta'' =  m l y'' sin th x'^2 + m g l sin th + tau

        a11 = (M+m)(1 + y'^2),   a12 = m l (cos th - y' sin th),   a22 = m l^2

    where F [N] acts on the hip along x and tau [N m] is the whole torque on theta (actuator plus
    disturbance). With ``p.prescribed`` the hip's motion is given (x'' = 0) and only the second row is
    solved. The determinant ``a11 a22 - a12^2`` is positive for positive masses and length.
    ``p.as_printed`` gives the paper's eq. 12 instead (`accelerations_as_printed`).
    """
    if p.as_printed:
        return accelerations_as_printed(state, hip_force, torque, p)
    x, theta, x_dot, theta_dot = state
    phase = p.wavenumber * x
    slope = p.amplitude * p.wavenumber * cos(phase)
    curvature = -p.amplitude * p.wavenumber * p.wavenumber * sin(phase)
    sin_theta = sin(theta)
    cos_theta = cos(theta)
    moment = p.trunk_mass * p.length
    a22 = moment * p.length
    b2 = moment * sin_theta * (curvature * x_dot * x_dot + p.gravity) + torque
    if p.prescribed:
        return 0.0, b2 / a22
    mass = p.hip_mass + p.trunk_mass
    a11 = mass * (1.0 + slope * slope)
    a12 = moment * (cos_theta - slope * sin_theta)
    normal = sin_theta + slope * cos_theta
    b1 = (
        moment * normal * theta_dot * theta_dot
        - mass * slope * (curvature * x_dot * x_dot + p.gravity)
        + hip_force
    )
    # a11 a22 - a12^2, in a form without cancellation: (cos - y' sin)^2 + (sin + y' cos)^2 = 1 + y'^2
    determinant = a22 * (p.hip_mass * (1.0 + slope * slope) + p.trunk_mass * normal * normal)
    return (a22 * b1 - a12 * b2) / determinant, (a11 * b2 - a12 * b1) / determinant


def energy(state: PlantState, p: PlantParameters) -> float:
    """Return the mechanical energy T + V in J (paper, eqs. 5 and 6); conserved while every input is zero.

    ::

        T = M/2 (x'^2 + y_dot^2) + m/2 ((x' + l th' cos th)^2 + (y_dot - l th' sin th)^2),  y_dot = y' x'
        V = M g y + m g (y + l cos th)
    """
    x, theta, x_dot, theta_dot = state
    y = p.amplitude * sin(p.wavenumber * x)
    y_dot = p.amplitude * p.wavenumber * cos(p.wavenumber * x) * x_dot
    com_x_dot = x_dot + p.length * theta_dot * cos(theta)
    com_y_dot = y_dot - p.length * theta_dot * sin(theta)
    kinetic = 0.5 * p.hip_mass * (x_dot * x_dot + y_dot * y_dot) + 0.5 * p.trunk_mass * (
        com_x_dot * com_x_dot + com_y_dot * com_y_dot
    )
    potential = p.gravity * (p.hip_mass * y + p.trunk_mass * (y + p.length * cos(theta)))
    return kinetic + potential
