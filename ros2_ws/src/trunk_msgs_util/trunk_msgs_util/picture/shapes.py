"""A run drawn as a few shapes: track, plant, drive, reference, disturbance.

Pure. The picture lies in the x-z plane, as `frames` has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from math import copysign, floor
from typing import Any, Protocol, runtime_checkable

from trunk_core.elementary import LARGEST_ANGLE, exp, sqrt
from trunk_core.parameters.shared import plant_in
from trunk_core.plugins import PLANT_GROUP, Registered, Registry

from .frames import BASE, BODY, Picture, Pose, Track, Visual, bar_of, poses, resolved

Point = tuple[float, float, float]
Color = tuple[float, float, float, float]  # red, green, blue, alpha, each from 0 to 1

FAR = 1e6  # m: nothing is drawn beyond
_PATH_REACH = 4.0  # m, on either side of the first frame
_PATH_STEP = 0.05  # m
_ARROW_REACH = 0.8  # m: the longest arrow approaches this
_ARROW_SCALE = 40.0  # N m or N: an arrow of about half that length
_LEAST_ARROW = 0.005  # m

GREY: Color = (0.6, 0.6, 0.6, 1.0)
BLUE: Color = (0.12, 0.47, 0.71, 1.0)
GHOST: Color = (0.17, 0.63, 0.17, 0.45)
ORANGE: Color = (1.0, 0.5, 0.05, 1.0)
FLASH: Color = (0.84, 0.15, 0.16, 0.5)
_COLORS = {BASE: GREY, BODY: BLUE}


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
    """What is drawn of a plant: its picture, with numbers alone, its joints, the driven coordinate."""

    picture: Picture
    joints: tuple[str, str]
    drive: int

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> Geometry:
        """Return the geometry of the plant with these parameters.

        Raises KeyError for one that is missing, ParameterError for a plant that is not installed or usable.
        """
        picture, drive = picture_of(parameters)
        hip, trunk = parameters["joints"]
        return cls(resolved(picture, parameters), (hip, trunk), drive)

    @cached_property
    def held(self) -> Visual:
        """The bar whose angle is held."""
        bar = bar_of(self.picture, 1)
        assert bar is not None, "a plant's picture has one"
        return bar

    @cached_property
    def reach(self) -> float:
        """How far from the world's origin something is seen at rest on level ground, in m."""
        level = poses(self.picture._replace(track=None), (0.0, 0.0))
        spots = [level[v.frame].point(spot) for v in self.picture.visuals for spot in v.points]
        return max(sqrt(x * x + z * z) for x, z in spots)

    def origin(self, x: float) -> Point:
        """Return the first frame's origin: the trunk's hip."""
        return _origin(self.picture, poses(self.picture, (x, 0.0)))

    def points(self, visual: Visual, x: float, theta: float) -> tuple[Point, ...]:
        """Return where a visual is."""
        return _points(visual, poses(self.picture, (x, theta)))


@runtime_checkable
class Drawn(Registered, Protocol):
    """What is read of a plant: this package is below those of plants."""

    picture: Picture
    drive: int


_PLANTS: Registry[Drawn] = Registry(PLANT_GROUP, "plant", lambda: Drawn, ())


def picture_of(parameters: Mapping[str, Any]) -> tuple[Picture, int]:
    """Return the picture of the plant with these parameters, and the coordinate that its command pushes.

    Raises ParameterError for a plant that is not installed, or cannot be used.
    """
    plant = plant_in(_PLANTS, parameters)
    return plant.picture, plant.drive


def _point(pose: Pose, spot: tuple[float, float]) -> Point:
    x, z = pose.point(spot)
    return (x, 0.0, z)


def _origin(picture: Picture, placed: Mapping[str, Pose]) -> Point:
    return _point(placed[picture.frames[0].name], (0.0, 0.0))


def _points(visual: Visual, placed: Mapping[str, Pose]) -> tuple[Point, ...]:
    return tuple(_point(placed[visual.frame], spot) for spot in visual.points)


@dataclass(frozen=True)
class Scene:
    """What is shown at one instant; None: not known."""

    x: float  # the first coordinate, m or rad
    theta: float  # the second, rad
    torque: float = 0.0  # of the drive, N m or N
    reference: float | None = None  # rad
    hip_disturbed: bool = False
    trunk_disturbed: bool = False


def is_drawn(geometry: Geometry, scene: Scene) -> bool:
    """Return True if a scene can be drawn: not too far away, and all sines are defined."""
    picture, position = geometry.picture, (scene.x, scene.theta)
    slides = [abs(position[f.slides]) for f in picture.frames if f.slides >= 0]
    angles = [sum(abs(f.sense * position[f.turns]) for f in picture.frames if f.turns >= 0)]
    if picture.track is not None:
        reach = _PATH_REACH + _PATH_STEP
        angles += [abs(picture.track.wavenumber) * (slide + reach) for slide in slides]
    return all(slide <= FAR for slide in slides) and all(a <= LARGEST_ANGLE for a in angles)


def shapes(geometry: Geometry, scene: Scene) -> list[Shape]:
    """Return the picture, always the same shapes in the same order; without points unless `is_drawn`."""
    if not is_drawn(geometry, scene):  # the same shapes, without points
        return [replace(shape, points=()) for shape in shapes(geometry, Scene(0.0, 0.0))]
    picture, held = geometry.picture, geometry.held
    placed = poses(picture, (scene.x, scene.theta))
    origin = _origin(picture, placed)
    pushed_hip = (origin,) if scene.hip_disturbed else ()
    pushed_tip = _points(held, placed)[-1:] if scene.trunk_disturbed else ()
    lines = [] if picture.track is None else [path(picture.track, origin[0])]
    return [
        *(Shape("path", Kind.LINE, GREY, 0.02, points) for points in lines),
        Shape("reference", Kind.LINE, GHOST, held.size, _ghost(geometry, scene)),
        *(
            Shape(
                visual.name,
                Kind.LINE if len(visual.points) > 1 else Kind.SPHERE,
                _COLORS[visual.role],
                visual.size,
                _points(visual, placed),
            )
            for visual in picture.visuals
        ),
        Shape("torque", Kind.ARROW, ORANGE, 0.04, _drive_arrow(geometry, scene.torque, placed)),
        Shape(f"disturbance/{picture.frames[0].name}", Kind.SPHERE, FLASH, 0.5, pushed_hip),
        Shape(f"disturbance/{held.frame}", Kind.SPHERE, FLASH, 0.5, pushed_tip),
    ]


def path(track: Track, x: float) -> tuple[Point, ...]:
    """Return a track near ``x``, on a fixed grid, so that it does not move along with what slides on it."""
    first = floor((x - _PATH_REACH) / _PATH_STEP)
    count = round(2.0 * _PATH_REACH / _PATH_STEP) + 1
    grid = [(first + i) * _PATH_STEP for i in range(count)]
    return tuple((at, 0.0, track.height(at)) for at in grid)


def _ghost(geometry: Geometry, scene: Scene) -> tuple[Point, ...]:
    if scene.reference is None or not is_drawn(geometry, Scene(scene.x, scene.reference)):
        return ()
    return geometry.points(geometry.held, scene.x, scene.reference)


def _tanh(x: float) -> float:
    """Return ``tanh x = 1 - 2 / (exp(2 x) + 1)``, the same on every machine; beyond +-20 it is +-1."""
    return 1.0 - 2.0 / (exp(2.0 * min(max(x, -20.0), 20.0)) + 1.0)


def _drive_arrow(
    geometry: Geometry, torque: float, placed: Mapping[str, Pose]
) -> tuple[Point, ...]:
    """Return the arrow at the end of the driven bar, or at the frame that slides, to where it is pushed.

    Its length goes with ``tanh(torque / 40 N m)``: small torques can be told apart, large ones fit. None at
    a bar that ends where it turns.
    """
    reach = _ARROW_REACH * _tanh(torque / _ARROW_SCALE)
    if not abs(reach) >= _LEAST_ARROW:  # also where the torque is not a number
        return ()
    bar = bar_of(geometry.picture, geometry.drive)
    if bar is None:
        x, y, z = _origin(geometry.picture, placed)
        return ((x, y, z), (x + reach, y, z))
    pose, (right, up) = placed[bar.frame], bar.points[-1]
    reach, lever = copysign(reach, pose.sense * reach), sqrt(right * right + up * up)
    if not lever:
        return ()
    x, z = pose.point((right, up))
    along, rise = pose._replace(x=0.0, z=0.0).point((up / lever, -right / lever))
    return ((x, 0.0, z), (x + reach * along, 0.0, z + reach * rise))
