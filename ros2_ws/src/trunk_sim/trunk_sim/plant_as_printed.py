"""Eqs. 11 and 12 of the paper exactly as printed: WRONG PHYSICS, kept to show what they would give.

Do not use it for anything else. What is wrong: gravity points up (both signs of G are wrong), so that
over a hip at rest the upright trunk is stable and needs no controller; the velocity terms
enter with the opposite sign (+M^-1 V) and one of them is not the Lagrangian's, so that energy is not
conserved and a free hip still throws the trunk about.

Pure: runs in CPython and compiles with numba unchanged.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

from trunk_msgs_util.elementary import sincos

if TYPE_CHECKING:
    from trunk_msgs_util.mechanics import Body

    from .plant import PlantState


def accelerations_as_printed(
    state: PlantState, hip_force: float, torque: float, body: Body
) -> tuple[float, float]:
    """Return ``(x_ddot, theta_ddot)`` in m/s^2 and rad/s^2 of ``Z'' = M^-1 (V Z' - G - U)``.

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
