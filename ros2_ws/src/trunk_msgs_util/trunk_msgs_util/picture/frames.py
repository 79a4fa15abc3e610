"""A plant's picture as data: frames that slide or turn with its coordinates, and bars and discs in them.

A planar URDF in the x-z plane, x forward and z up; a positive angle turns from z towards x. So pages, films
and 3-D views draw any plant by the same few rules, and none of them runs a plant's code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from trunk_core.elementary import cos, sin
from trunk_core.mechanics import harmonics_of, path_height

BASE, BODY = "base", "body"  # roles: grey, and the colour of the run


class Scaled(NamedTuple):
    """A parameter's value times a factor."""

    name: str
    factor: float


# A float, `Scaled`, or the name of a parameter, which stands for its value; only these names have dots.
Number: TypeAlias = Any
Spot: TypeAlias = tuple[Number, Number]  # along a frame's x and z


class Frame(NamedTuple):
    """A frame at a place in the frame ``on``, by default the world.

    It slides along x with the coordinate ``slides``, or turns by ``sense`` times the coordinate ``turns``:
    0 or 1. One that slides in the world follows the track.
    """

    name: str
    on: str = ""
    at: Spot = (0.0, 0.0)
    slides: int = -1
    turns: int = -1
    sense: float = 1.0


class Visual(NamedTuple):
    """What is seen in a frame: a bar of this width through several points, or a disc of this diameter at one.

    ``page``: the size on pages, where it is another; it is never too small to be seen there.
    """

    name: str
    frame: str
    points: tuple[Spot, ...]
    size: Number
    role: str
    page: Number | None = None


class Track(NamedTuple):
    """The line y(x) that frames slide along: ``A sin(k x)`` and harmonics, as `path_height` adds them."""

    amplitude: Number = 0.0
    wavenumber: Number = 0.0  # rad/m
    cosines: str | Sequence[float] = ()
    sines: str | Sequence[float] = ()

    @property
    def harmonics(self) -> tuple[float, ...] | None:
        """The harmonics as `path_height` takes them."""
        return harmonics_of(self.cosines, self.sines)  # type: ignore[arg-type]

    def height(self, x: float) -> float:
        """Return y(x) in m."""
        return path_height(x, self.amplitude, self.wavenumber, self.harmonics)


class Picture(NamedTuple):
    """A plant's picture; each frame comes after the one it is on. ``track``: None for a fixed pivot."""

    frames: tuple[Frame, ...]
    visuals: tuple[Visual, ...]
    track: Track | None = None


class Pose(NamedTuple):
    """Where a frame is in another: its origin in m, how far it is turned in rad, and in which sense."""

    x: float = 0.0
    z: float = 0.0
    angle: float = 0.0
    sense: float = 1.0

    def point(self, spot: Spot) -> tuple[float, float]:
        """Return a spot of the frame as x and z in the other."""
        s, c = sin(self.angle), cos(self.angle)
        return self.x + (spot[0] * c + spot[1] * s), self.z + (spot[1] * c - spot[0] * s)


def resolved(part: Any, parameters: Mapping[str, Any]) -> Any:
    """Return a picture with its parameters' values. Raises KeyError for a parameter that is not known."""
    if isinstance(part, Scaled):
        return parameters[part.name] * part.factor
    if isinstance(part, tuple):
        items = [resolved(item, parameters) for item in part]
        return type(part)(*items) if hasattr(part, "_fields") else tuple(items)
    return parameters[part] if isinstance(part, str) and "." in part else part


def as_data(part: Any) -> Any:
    """Return a picture as JSON has it."""
    if hasattr(part, "_asdict"):
        return {name: as_data(value) for name, value in part._asdict().items()}
    return [as_data(item) for item in part] if isinstance(part, list | tuple) else part


def local_pose(picture: Picture, frame: Frame, position: tuple[float, float]) -> Pose:
    """Return where a frame is in the one it is on, for the two coordinates in m or rad."""
    (x, z), angle = frame.at, 0.0
    if frame.slides >= 0:
        x += position[frame.slides]
        if picture.track is not None and not frame.on:
            z += picture.track.height(x)
    if frame.turns >= 0:
        angle = frame.sense * position[frame.turns]
    return Pose(x, z, angle, frame.sense)


def poses(picture: Picture, position: tuple[float, float]) -> dict[str, Pose]:
    """Return where all frames are in the world, by name; ``""`` is the world itself."""
    placed = {"": Pose()}
    for frame in picture.frames:
        on, pose = placed[frame.on], local_pose(picture, frame, position)
        placed[frame.name] = Pose(*on.point(pose[:2]), on.angle + pose.angle, frame.sense)
    return placed


def bar_of(picture: Picture, coordinate: int) -> Visual | None:
    """Return the last bar of a frame that turns with a coordinate; its last point is what hands hold."""
    turning = [frame.name for frame in picture.frames if frame.turns == coordinate]
    bars = (visual for visual in picture.visuals[::-1] if len(visual.points) > 1)
    return next((bar for bar in bars if bar.frame in turning), None)
