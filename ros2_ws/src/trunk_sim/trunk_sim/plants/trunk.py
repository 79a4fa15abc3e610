"""The paper's plant: a trunk whose hip rides a sinusoidal path, held upright by torque at the hip.

Pure functions that CPython runs and numba compiles unchanged (`trunk_core.mechanics` has the equations).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, pi

from trunk_core.elementary import sincos
from trunk_core.mechanics import (
    Body,
    forward_dynamics,
    path_height,
    path_slope,
    prescribed_dynamics,
)
from trunk_core.parameters.declarations import ParameterError, parameter
from trunk_core.parameters.shared import body_of, body_parameter
from trunk_msgs_util.picture.frames import BASE, BODY, Frame, Picture, Scaled, Track, Visual

from ..plant import Accelerations, Coordinate, Plant, PlantConfig, PlantState

EQUATIONS = ("derived", "as_printed")


def passive(state: PlantState, hip_force: float, torque: float, body: Body) -> tuple[float, float]:
    """Return ``(x_ddot, theta_ddot)`` in m/s^2 and rad/s^2 of a hip that rolls freely (`forward_dynamics`).

    F [N] acts on the hip along x; tau [N m] is the whole torque on theta (actuator plus disturbance).
    """
    x, theta, x_dot, theta_dot = state
    return forward_dynamics(x, theta, x_dot, theta_dot, hip_force, torque, body)


def prescribed(
    state: PlantState, hip_force: float, torque: float, body: Body
) -> tuple[float, float]:
    """Return ``(0, theta_ddot)``, as `passive` does, of a hip that keeps its horizontal speed."""
    x, theta, x_dot, theta_dot = state
    return prescribed_dynamics(x, theta, x_dot, theta_dot, torque, body)


def as_printed(
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


def level(body: Body) -> Body:
    """Return the same trunk on level ground."""
    return body._replace(amplitude=0.0, harmonics=None)


def largest_angle(state: PlantState, body: Body) -> float:
    """Return the largest angle whose sine is taken, rad: the path's phase k x is one."""
    return max(abs(state.x * body.wavenumber), abs(state.theta))


@dataclass(frozen=True)
class TrunkConfig(PlantConfig):
    """Parameters of trunk, hip and path."""

    hip_mass: float = body_parameter("plant.hip_mass", "hip_mass")
    trunk_mass: float = body_parameter("plant.trunk_mass", "trunk_mass")
    length: float = body_parameter("plant.length", "length")
    gravity: float = body_parameter("plant.gravity", "gravity")
    equations: str = parameter(
        "plant.equations",
        "derived",
        "derived from the paper's Lagrangian, or as_printed: its misprinted eq. 12, wrong physics",
        choices=EQUATIONS,
    )
    amplitude: float = body_parameter("path.amplitude", "amplitude")
    wavenumber: float = body_parameter("path.wavenumber", "wavenumber")
    cosines: tuple[float, ...] = body_parameter("path.cosines", "cosines")
    sines: tuple[float, ...] = body_parameter("path.sines", "sines")
    hip_mode: str = body_parameter("hip.mode", "hip_mode")

    def __post_init__(self) -> None:
        super().__post_init__()
        path = self.amplitude, self.wavenumber, self.constants.harmonics
        printed = (path, self.hip_mode) == ((1.0, 1.0, None), "passive")
        if self.equations == "as_printed" and not printed:
            raise ParameterError(
                "plant.equations",
                self.equations,
                "derived, where path.amplitude or path.wavenumber is not 1, path.cosines or path.sines "
                "not empty or hip.mode not passive: the paper prints no other case",
            )

    @property
    def constants(self) -> Body:
        """The constants of hip, trunk and path."""
        return body_of(self)

    @property
    def accelerations(self) -> Accelerations:
        """The equations of motion that ``plant.equations`` and ``hip.mode`` choose."""
        if self.equations == "as_printed":
            return as_printed
        return prescribed if self.hip_mode == "prescribed" else passive


_TOP = (0.0, "plant.length")
PICTURE = Picture(
    (Frame("hip", slides=0), Frame("trunk", on="hip", turns=1)),
    (
        Visual("trunk", "trunk", ((0.0, 0.0), _TOP), 0.06, BODY, page=0.0),
        Visual("hip", "hip", ((0.0, 0.0),), 0.2, BASE, page=Scaled("plant.length", 0.2)),
        Visual("mass", "trunk", (_TOP,), 0.16, BODY, page=Scaled("plant.length", 0.26)),
    ),
    Track("path.amplitude", "path.wavenumber", "path.cosines", "path.sines"),
)
PLANT = Plant(
    "trunk",
    "Trunk",
    TrunkConfig,
    (Coordinate("hip", "m"), Coordinate("trunk", "rad")),
    passive,
    PICTURE,
    start=PlantState(0.0, pi / 6.0, 1.0, 0.0),
    energy=energy,
    held=prescribed,
    level=level,
    largest_angle=largest_angle,
)
