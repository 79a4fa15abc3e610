"""A run drawn as a few shapes: the hip's path, hip, trunk, torque, reference, disturbance.

Pure. The picture lies in the x-z plane, x forward and z up; positive theta leans forward from the vertical.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from math import floor

from ..elementary import LARGEST_ANGLE, cos, exp, sin
from ..mechanics import Body, harmonics_of, path_height

_BODY = Body()

Point = tuple[float, float, float]
Color = tuple[float, float, float, float]  # red, green, blue, alpha, each from 0 to 1

FAR = 1e6  # m: nothing is drawn beyond
_PATH_REACH = 4.0  # m, on either side of the hip
_PATH_STEP = 0.05  # m
_ARROW_REACH = 0.8  # m: the longest arrow approaches this
_ARROW_SCALE = 40.0  # N m: an arrow of about half that length
_LEAST_ARROW = 0.005  # m

HIP_SIZE, TRUNK_SIZE, MASS_SIZE = 0.2, 0.06, 0.16  # m

GREY: Color = (0.6, 0.6, 0.6, 1.0)
BLUE: Color = (0.12, 0.47, 0.71, 1.0)
GHOST: Color = (0.17, 0.63, 0.17, 0.45)
ORANGE: Color = (1.0, 0.5, 0.05, 1.0)
FLASH: Color = (0.84, 0.15, 0.16, 0.5)


class Kind(IntEnum):
    """Kinds of shape, with the numbers of visualization_msgs/Marker."""

    ARROW = 0  # from the first point to the second
    SPHERE = 2  # around the first point
    LINE = 4  # through all points


@dataclass(frozen=True)
class Shape:
    """One shape; without points it is not drawn. ``size``: width, shaft or diameter, m."""

    name: str
    kind: Kind
    color: Color
    size: float
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Geometry:
    """The constants that a picture needs (SI units), by default the plant's."""

    length: float = _BODY.length  # l, hip to centre of mass
    amplitude: float = _BODY.amplitude  # A
    wavenumber: float = _BODY.wavenumber  # k
    harmonics: tuple[float, ...] | None = _BODY.harmonics
    joints: tuple[str, str] = ("hip", "trunk")

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, object]) -> Geometry:
        """Return the geometry from the simulator's parameters, by name."""
        names = {
            "length": "plant.length",
            "amplitude": "path.amplitude",
            "wavenumber": "path.wavenumber",
            "joints": "joints",
        }
        known = {field: parameters[name] for field, name in names.items() if name in parameters}
        if isinstance(known.get("joints"), list | tuple):
            known["joints"] = tuple(known["joints"])  # type: ignore[arg-type]
        cosines, sines = (parameters.get(f"path.{name}", ()) for name in ("cosines", "sines"))
        known["harmonics"] = harmonics_of(cosines, sines)  # type: ignore[arg-type]
        return cls(**known)  # type: ignore[arg-type]

    def hip(self, x: float) -> Point:
        """Return the place of the hip: on its path, z being `path_height`."""
        return (x, 0.0, path_height(x, self.amplitude, self.wavenumber, self.harmonics))

    def mass(self, x: float, theta: float) -> Point:
        """Return the place of the trunk's centre of mass."""
        hip = self.hip(x)
        return (x + self.length * sin(theta), 0.0, hip[2] + self.length * cos(theta))


@dataclass(frozen=True)
class Scene:
    """What is shown at one instant; None: not known."""

    x: float  # m
    theta: float  # rad
    torque: float = 0.0  # N m
    reference: float | None = None  # rad
    hip_disturbed: bool = False
    trunk_disturbed: bool = False


def is_drawn(geometry: Geometry, scene: Scene) -> bool:
    """Return True if a scene can be drawn: not too far away, and the sines of path and angle are defined."""
    along = abs(geometry.wavenumber) * (abs(scene.x) + _PATH_REACH + _PATH_STEP)
    return abs(scene.x) <= FAR and along <= LARGEST_ANGLE and abs(scene.theta) <= LARGEST_ANGLE


def shapes(geometry: Geometry, scene: Scene) -> list[Shape]:
    """Return the picture, always the same shapes in the same order; without points unless `is_drawn`."""
    if not is_drawn(geometry, scene):  # the same shapes, without points
        return [replace(shape, points=()) for shape in shapes(geometry, Scene(0.0, 0.0))]
    hip = geometry.hip(scene.x)
    mass = geometry.mass(scene.x, scene.theta)
    pushed_hip = (hip,) if scene.hip_disturbed else ()
    pushed_mass = (mass,) if scene.trunk_disturbed else ()
    return [
        Shape("path", Kind.LINE, GREY, 0.02, path(geometry, scene.x)),
        Shape("reference", Kind.LINE, GHOST, 0.06, _ghost(geometry, scene)),
        Shape("trunk", Kind.LINE, BLUE, TRUNK_SIZE, (hip, mass)),
        Shape("hip", Kind.SPHERE, GREY, HIP_SIZE, (hip,)),
        Shape("mass", Kind.SPHERE, BLUE, MASS_SIZE, (mass,)),
        Shape("torque", Kind.ARROW, ORANGE, 0.04, torque_arrow(geometry, scene)),
        Shape("disturbance/hip", Kind.SPHERE, FLASH, 0.5, pushed_hip),
        Shape("disturbance/trunk", Kind.SPHERE, FLASH, 0.5, pushed_mass),
    ]


def path(geometry: Geometry, x: float) -> tuple[Point, ...]:
    """Return the path near ``x``, on a fixed grid, so that it does not move along with the hip."""
    first = floor((x - _PATH_REACH) / _PATH_STEP)
    count = round(2.0 * _PATH_REACH / _PATH_STEP) + 1
    return tuple(geometry.hip((first + i) * _PATH_STEP) for i in range(count))


def _ghost(geometry: Geometry, scene: Scene) -> tuple[Point, ...]:
    if scene.reference is None or not abs(scene.reference) <= LARGEST_ANGLE:
        return ()
    return (geometry.hip(scene.x), geometry.mass(scene.x, scene.reference))


def _tanh(x: float) -> float:
    """Return ``tanh x = 1 - 2 / (exp(2 x) + 1)``, the same on every machine; beyond +-20 it is +-1."""
    return 1.0 - 2.0 / (exp(2.0 * min(max(x, -20.0), 20.0)) + 1.0)


def torque_arrow(geometry: Geometry, scene: Scene) -> tuple[Point, ...]:
    """Return the arrow at the mass, in the direction in which the torque pushes it.

    Its length goes with ``tanh(torque / 40 N m)``: small torques can be told apart, large ones fit.
    """
    reach = _ARROW_REACH * _tanh(scene.torque / _ARROW_SCALE)
    if not abs(reach) >= _LEAST_ARROW:  # also where the torque is not a number
        return ()
    x, y, z = geometry.mass(scene.x, scene.theta)
    return ((x, y, z), (x + reach * cos(scene.theta), y, z - reach * sin(scene.theta)))
