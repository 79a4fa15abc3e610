"""Mechanics of a trunk whose hip rides a periodic path: the path and the equations of motion.

The hip (mass M) is at ``(x, y)`` with ``y = A sin(k x)``, to which a Fourier series in k x may be added
(`harmonics_at`); the trunk's centre of mass (mass m) is at
``(x + l sin theta, y + l cos theta)``, theta measured from the upward vertical, forward lean positive.
Derived from the Lagrangian of the paper (its eq. 7); every misprint of its eqs. 8-12 is corrected.
The plant solves the equations for the accelerations, a model-based controller for the torque.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import NamedTuple

from .elementary import sincos

MOST_HARMONICS = 32


class Body(NamedTuple):
    """Constants of hip, trunk and path (SI units), by default the paper's Table 5 where it prints one."""

    hip_mass: float = 2.0  # M, kg
    trunk_mass: float = 0.5  # m, kg
    length: float = 1.0  # l, m, hip to centre of mass
    gravity: float = 9.81  # g, m/s^2
    amplitude: float = 1.0  # A, m
    wavenumber: float = 1.0  # k, rad/m
    # a1, b1, a2, b2 ..., m: added to the path (`harmonics_at`). None where there are none, so that
    # compiled code leaves them out; else a tuple, of which compiled code gets an array.
    harmonics: tuple[float, ...] | None = None


Motion = tuple[float, float, float, float, float, float]


def harmonics_of(cosines: Sequence[float], sines: Sequence[float]) -> tuple[float, ...] | None:
    """Return a body's ``harmonics`` of the coefficients a1, a2 ... and b1, b2 ... in m.

    The shorter list is filled up with zeros; zeros at the end have no effect. None if all are 0.
    """
    count = max(len(cosines), len(sines))
    pairs = [(part[n] if n < len(part) else 0.0) for n in range(count) for part in (cosines, sines)]
    while pairs and pairs[-1] == pairs[-2] == 0.0:
        del pairs[-2:]
    return tuple(pairs) or None


def has_harmonics(harmonics: Sequence[float] | None) -> bool:
    """Return True if anything is added to the path: a compiler removes the branch of None, as an argument."""
    if harmonics is None:
        return False
    return len(harmonics) > 0


def harmonics_at(
    sin_phase: float, cos_phase: float, wavenumber: float, harmonics: Sequence[float] | None
) -> tuple[float, float, float]:
    """Return the harmonics' part of the path's height [m], slope and curvature [1/m] at the phase k x.

    ::

        y   = sum over n = 1 ... N of  a_n cos(n k x) + b_n sin(n k x)
        y'  = sum of  (n k) b_n cos(n k x) - (n k) a_n sin(n k x)
        y'' = sum of -(n k)^2 a_n cos(n k x) - (n k)^2 b_n sin(n k x)

    added up from n = 1. Sine and cosine of n k x follow from those of (n-1) k x by the addition theorem,
    within about n units of 2^-53. So one sine and one bound on the angle are enough, and the rounding of
    k x shifts all harmonics alike.
    """
    if harmonics is None:
        return 0.0, 0.0, 0.0
    height, slope, curvature = 0.0, 0.0, 0.0
    s, c, n = sin_phase, cos_phase, 0.0
    for i in range(0, len(harmonics), 2):
        n += 1.0
        wave = n * wavenumber
        a, b = harmonics[i], harmonics[i + 1]
        height += a * c + b * s
        slope += b * wave * c - a * wave * s
        curvature -= a * wave * wave * c + b * wave * wave * s
        s, c = s * cos_phase + c * sin_phase, c * cos_phase - s * sin_phase
    return height, slope, curvature


def path_height(
    x: float, amplitude: float, wavenumber: float, harmonics: Sequence[float] | None = None
) -> float:
    """Return the path's height in m: ``y = A sin(k x)`` and what the harmonics add."""
    s, c = sincos(wavenumber * x)
    return amplitude * s + harmonics_at(s, c, wavenumber, harmonics)[0]


def path_slope(
    x: float, amplitude: float, wavenumber: float, harmonics: Sequence[float] | None = None
) -> float:
    """Return the path's slope: ``y' = A k cos(k x)`` and what the harmonics add."""
    s, c = sincos(wavenumber * x)
    return amplitude * wavenumber * c + harmonics_at(s, c, wavenumber, harmonics)[1]


def equations_of_motion(
    x: float, theta: float, x_dot: float, theta_dot: float, body: Body
) -> Motion:
    """Return ``(a11, a12, a22, b1, b2, det)`` of the equations without a force or a torque.

    ::

        a11 x'' + a12 theta'' = b1 + F,     b1 = -(M+m) y' (y'' x'^2 + g) + m l (sin th + y' cos th) th'^2
        a12 x'' + a22 theta'' = b2 + tau,   b2 = m l sin th (y'' x'^2 + g)

        a11 = (M+m)(1 + y'^2),   a12 = m l (cos th - y' sin th),   a22 = m l^2
        det = a11 a22 - a12^2 = m l^2 (M (1 + y'^2) + m (sin th + y' cos th)^2)

    with ``y' = A k cos(k x)`` and ``y'' = -A k^2 sin(k x)``, and what the harmonics add (`harmonics_at`).
    The determinant is in a form without cancellation, and is positive for positive masses and length.
    NaN where k x or theta is beyond `elementary.LARGEST_ANGLE`.
    """
    amplitude, k = body.amplitude, body.wavenumber
    sin_phase, cos_phase = sincos(k * x)
    sin_theta, cos_theta = sincos(theta)
    slope = amplitude * k * cos_phase
    curvature = -amplitude * k * k * sin_phase
    if has_harmonics(body.harmonics):  # an added zero could change the sign of another
        added = harmonics_at(sin_phase, cos_phase, k, body.harmonics)
        slope += added[1]
        curvature += added[2]
    moment = body.trunk_mass * body.length
    a22 = moment * body.length
    effective_gravity = curvature * x_dot * x_dot + body.gravity
    mass = body.hip_mass + body.trunk_mass
    arc = 1.0 + slope * slope
    normal = sin_theta + slope * cos_theta
    return (
        mass * arc,
        moment * (cos_theta - slope * sin_theta),
        a22,
        moment * normal * theta_dot * theta_dot - mass * slope * effective_gravity,
        moment * sin_theta * effective_gravity,
        # (cos - y' sin)^2 + (sin + y' cos)^2 = 1 + y'^2
        a22 * (body.hip_mass * arc + body.trunk_mass * normal * normal),
    )


def forward_dynamics(
    x: float,
    theta: float,
    x_dot: float,
    theta_dot: float,
    hip_force: float,
    torque: float,
    body: Body,
) -> tuple[float, float]:
    """Return ``(x'', theta'')`` in m/s^2 and rad/s^2 under a force F [N] along x and a torque [N m].

    The hip is passive: it rolls freely on its path. NaN if an angle is beyond `elementary.LARGEST_ANGLE`, or
    the motion too large for floats.
    """
    a11, a12, a22, b1, b2, determinant = equations_of_motion(x, theta, x_dot, theta_dot, body)
    b1, b2 = b1 + hip_force, b2 + torque
    if determinant > 0.0:
        return (a22 * b1 - a12 * b2) / determinant, (a11 * b2 - a12 * b1) / determinant
    return nan, nan  # underflow, or an angle that is too large


def prescribed_dynamics(
    x: float, theta: float, x_dot: float, theta_dot: float, torque: float, body: Body
) -> tuple[float, float]:
    """Return ``(x'', theta'')`` as `forward_dynamics` does for a hip that keeps its horizontal speed.

    So x'' = 0, and only the second row is solved.
    """
    _, _, a22, _, b2, _ = equations_of_motion(x, theta, x_dot, theta_dot, body)
    return 0.0, (b2 + torque) / a22 if a22 != 0.0 else nan


def inverse_dynamics(
    x: float, theta: float, x_dot: float, theta_dot: float, body: Body, prescribed: bool = False
) -> tuple[float, float]:
    """Return ``(H, c)`` [kg m^2, N m] of ``tau = H theta'' + c``, the hip's own motion eliminated.

    ::

        H = det / a11,    c = (a12 / a11) b1 - b2

    A ``prescribed`` hip leaves ``H = a22`` and ``c = -b2``. NaN as in `forward_dynamics`.
    """
    a11, a12, a22, b1, b2, determinant = equations_of_motion(x, theta, x_dot, theta_dot, body)
    if prescribed:
        return a22, -b2
    if a11 == 0.0:
        return nan, nan
    return determinant / a11, a12 / a11 * b1 - b2
