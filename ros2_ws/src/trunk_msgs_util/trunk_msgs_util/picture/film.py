"""`Film`: the pictures that a recording gets, at most 30 for each second of simulated time.

They are what RViz's and Foxglove's 3-D views draw. ``markers``: the shapes. ``robot_description`` and ``tf``:
a URDF, and where its links are. A viewer needs the transforms: the URDF's joints know nothing of the path's
height, and a viewer may not read joint states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from xml.sax.saxutils import quoteattr

from ..elementary import cos, sin
from ..recording.schemas import build, serialize
from ..samples import JointSample
from ..topics import MARKER_ARRAY_TYPE, MARKERS, ROBOT_DESCRIPTION, STRING_TYPE, TF, TF_TYPE
from ..units import NANOSECONDS
from .shapes import (
    BLUE,
    GREY,
    HIP_SIZE,
    MASS_SIZE,
    TRUNK_SIZE,
    Color,
    Geometry,
    Kind,
    Point,
    Scene,
    Shape,
    is_drawn,
    shapes,
)

WORLD, HIP_LINK, TRUNK_LINK = "world", "hip_link", "trunk_link"

_DELETE = 2  # an action of a marker; 0: add
Fields = dict[str, Any]  # of a message

RATE = 30.0  # Hz
_EVERY_NS = round(NANOSECONDS / RATE)


class Film:
    """Draws true states with the newest of everything else, and yields topics (relative) and messages."""

    def __init__(self) -> None:
        self._plant: dict[str, object] = {}
        self._geometry = Geometry()
        self._described = ""
        self._due_ns = 0
        self._last_ns = -1

    def reconfigure(self, parameters: Mapping[str, object]) -> None:
        """Take the simulator's parameters, or some that have changed."""
        self._plant.update(parameters)
        self._geometry = Geometry.from_parameters(self._plant)

    def is_due(self, stamp_ns: int) -> bool:
        """Return True if the state with this stamp is to be drawn; it starts over if stamps go back."""
        if stamp_ns < self._last_ns:
            self._due_ns = 0
        self._last_ns = stamp_ns
        return stamp_ns >= self._due_ns

    def drawn(self, stamp_ns: int) -> None:
        """Note that the state with this stamp is drawn: the next is due a while later."""
        self._due_ns = (stamp_ns // _EVERY_NS + 1) * _EVERY_NS

    def picture(
        self,
        truth: JointSample,
        disturbance: JointSample | None,
        reference: float | None,
        log_ns: int,
    ) -> Iterator[tuple[str, bytes]]:
        """Yield the messages of a true state's picture; the URDF first, if it has changed.

        ``reference`` in rad, None if it is not known. ``log_ns``: when they are logged. They are stamped with
        it, because a viewer looks up a transform at its playback time.
        """
        self.drawn(truth.stamp_ns)
        text = urdf(self._geometry)
        if text != self._described:
            self._described = text
            yield ROBOT_DESCRIPTION, description(text)
        scene = scene_of(self._geometry, truth, disturbance, reference)
        if scene is None:
            return
        yield MARKERS, markers(shapes(self._geometry, scene), log_ns)
        if is_drawn(self._geometry, scene):
            yield TF, transforms(self._geometry, scene.x, scene.theta, log_ns)


def scene_of(
    geometry: Geometry,
    truth: JointSample,
    disturbance: JointSample | None,
    reference: float | None,
) -> Scene | None:
    """Return the scene of a true state; None if it does not have our joints."""
    hip, trunk = geometry.joints
    x, theta = value(truth, "position", hip), value(truth, "position", trunk)
    if x is None or theta is None:
        return None
    pushed = (
        any(value(disturbance, field, joint) for field in ("effort", "position"))
        for joint in (hip, trunk)
    )
    return Scene(x, theta, value(truth, "effort", trunk) or 0.0, reference, *pushed)


def value(sample: JointSample | None, field: str, name: str) -> float | None:
    """Return a named value of ``position`` or ``effort``; None without it."""
    if sample is None or name not in sample.name:
        return None
    values: tuple[float, ...] = getattr(sample, field)
    index = sample.name.index(name)
    return values[index] if index < len(values) else None


def urdf(geometry: Geometry) -> str:
    """Return the robot: a hip that moves along x, and a trunk that turns about y.

    Lengths in m. A URDF cannot say that the hip's height follows its path: ``tf`` does.
    """
    hip, trunk = (quoteattr(joint) for joint in geometry.joints)
    length = geometry.length
    return f"""<?xml version="1.0"?>
<robot name="trunk">
{_material("grey", GREY)}
{_material("blue", BLUE)}
  <link name="{WORLD}"/>
  <link name="{HIP_LINK}">
    <visual><geometry><sphere radius="{HIP_SIZE / 2.0!r}"/></geometry><material name="grey"/></visual>
  </link>
  <link name="{TRUNK_LINK}">
    <visual>
      <origin xyz="0 0 {length / 2.0!r}"/>
      <geometry><cylinder radius="{TRUNK_SIZE / 2.0!r}" length="{length!r}"/></geometry>
      <material name="blue"/>
    </visual>
    <visual>
      <origin xyz="0 0 {length!r}"/>
      <geometry><sphere radius="{MASS_SIZE / 2.0!r}"/></geometry>
      <material name="blue"/>
    </visual>
  </link>
  <joint name={hip} type="prismatic">
    <parent link="{WORLD}"/>
    <child link="{HIP_LINK}"/>
    <axis xyz="1 0 0"/>
    <limit lower="-1000000.0" upper="1000000.0" effort="0.0" velocity="1000000.0"/>
  </joint>
  <joint name={trunk} type="continuous">
    <parent link="{HIP_LINK}"/>
    <child link="{TRUNK_LINK}"/>
    <axis xyz="0 1 0"/>
  </joint>
</robot>
"""


def _material(name: str, color: Color) -> str:
    rgba = " ".join(f"{part:g}" for part in color)
    return f'  <material name="{name}"><color rgba="{rgba}"/></material>'


def markers(drawn: Sequence[Shape], stamp_ns: int, frame: str = WORLD) -> bytes:
    """Return some shapes as visualization_msgs/MarkerArray; one without points is deleted."""
    content = [_marker(shape, _header(stamp_ns, frame)) for shape in drawn]
    return serialize(MARKER_ARRAY_TYPE, build(MARKER_ARRAY_TYPE, markers=content))


def transforms(geometry: Geometry, x: float, theta: float, stamp_ns: int) -> bytes:
    """Return the links' places as tf2_msgs/TFMessage, for a hip at x [m] and an angle theta [rad].

    ::

        hip_link in world         (x, 0, the path's height at x)
        trunk_link in hip_link    turned by theta about y: a rotation from z towards x
    """
    hip = {"translation": _xyz(geometry.hip(x)), "rotation": {"w": 1.0}}
    trunk = {"rotation": {"y": sin(theta / 2.0), "w": cos(theta / 2.0)}}
    links = [
        {"header": _header(stamp_ns, parent), "child_frame_id": child, "transform": transform}
        for parent, child, transform in ((WORLD, HIP_LINK, hip), (HIP_LINK, TRUNK_LINK, trunk))
    ]
    return serialize(TF_TYPE, build(TF_TYPE, transforms=links))


def description(text: str) -> bytes:
    """Return a URDF as std_msgs/String."""
    return serialize(STRING_TYPE, build(STRING_TYPE, data=text))


def _marker(shape: Shape, header: Fields) -> Fields:
    """Return the fields of a visualization_msgs/Marker."""
    marker = {"header": header, "ns": shape.name, "type": int(shape.kind)}
    if not shape.points:
        return marker | {"action": _DELETE}
    size, place, points = shape.size, (0.0, 0.0, 0.0), shape.points
    scale = (size, 0.0, 0.0)
    if shape.kind is Kind.SPHERE:
        scale, place, points = (size, size, size), shape.points[0], ()
    elif shape.kind is Kind.ARROW:  # the head's diameter and length
        scale = (size, 2.5 * size, 3.0 * size)
    return marker | {
        "pose": {"position": _xyz(place), "orientation": {"w": 1.0}},
        "scale": _xyz(scale),
        "color": dict(zip("rgba", shape.color, strict=True)),
        "points": [_xyz(point) for point in points],
    }


def _header(stamp_ns: int, frame: str) -> Fields:
    sec, nanosec = divmod(stamp_ns, NANOSECONDS)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def _xyz(at: Point) -> Fields:
    return dict(zip("xyz", at, strict=True))
