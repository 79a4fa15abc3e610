"""A run as ROS 2 shows it: scene, URDF, markers, transforms; and `Film`, the pictures that a recording gets.

At most 30 for each second of simulated time.
They are what RViz's and Foxglove's 3-D views draw. ``markers``: the shapes. ``robot_description`` and ``tf``:
a URDF, and where its links are. A viewer needs the transforms: the URDF's joints know nothing of the path's
height, and a viewer may not read joint states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, pairwise
from typing import Any
from xml.sax.saxutils import quoteattr

from trunk_core.elementary import atan2, cos, sin, sqrt
from trunk_core.parameters.declarations import ParameterError
from trunk_core.samples import JointSample
from trunk_core.topics import (
    MARKER_ARRAY_TYPE,
    MARKERS,
    ROBOT_DESCRIPTION,
    STRING_TYPE,
    TF,
    TF_TYPE,
)
from trunk_core.units import NANOSECONDS
from trunk_recording.schemas import build, serialize

from .frames import BASE, Frame, Visual, local_pose
from .shapes import (
    BLUE,
    GREY,
    Color,
    Geometry,
    Kind,
    Point,
    Scene,
    Shape,
    is_drawn,
    shapes,
)

WORLD = "world"

_DELETE = 2  # an action of a marker; 0: add
Fields = dict[str, Any]  # of a message

RATE = 30.0  # Hz
_EVERY_NS = round(NANOSECONDS / RATE)


class Film:
    """Draws true states with the newest of everything else, and yields topics (relative) and messages."""

    def __init__(self) -> None:
        self.geometry: Geometry | None = None  # of the plant, if it is known
        self._plant: dict[str, object] = {}
        self._described = ""
        self._due_ns = 0
        self._last_ns = -1

    def reconfigure(self, new: Mapping[str, object], changed: Mapping[str, object]) -> str:
        """Take the simulator's parameters: all of a simulator that is new, and those that have changed.

        Return why a new one is not drawn, its plant not being installed; empty if nothing is wrong.
        """
        self._plant, self.geometry = {**(new or self._plant), **changed}, None
        try:
            self.geometry = Geometry.from_parameters(self._plant)
        except KeyError:  # not all of them are known yet
            pass
        except ParameterError as error:
            return f"no picture is drawn: {error}" if new else ""
        return ""

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
        geometry = self.geometry
        if geometry is None:
            return
        text = urdf(geometry)
        if text != self._described:
            self._described = text
            yield ROBOT_DESCRIPTION, description(text)
        scene = scene_of(geometry, truth, disturbance, reference)
        if scene is None:
            return
        yield MARKERS, markers(shapes(geometry, scene), log_ns)
        if is_drawn(geometry, scene):
            yield TF, transforms(geometry, scene.x, scene.theta, log_ns)


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
    """Return the robot: a link for each frame, which slides along x, turns about y or is fixed.

    Lengths in m. A URDF cannot say that what slides follows a track: ``tf`` does.
    """
    picture = geometry.picture
    links = []
    for frame in picture.frames:
        seen = (visual for visual in picture.visuals if visual.frame == frame.name)
        solids = "".join(chain.from_iterable(map(_solids, seen)))
        links.append(f'  <link name="{_link(frame.name)}">\n{solids}  </link>\n')
    return f"""<?xml version="1.0"?>
<robot name="{picture.frames[-1].name}">
{_material("grey", GREY)}
{_material("blue", BLUE)}
  <link name="{WORLD}"/>
{"".join(links)}{"".join(_joint(geometry, frame) for frame in picture.frames)}</robot>
"""


def _link(frame: str) -> str:
    return f"{frame}_link" if frame else WORLD


def _joint(geometry: Geometry, frame: Frame) -> str:
    """Return a frame's joint, with the name that states have if it is the first that its coordinate moves."""
    coordinate = max(frame.slides, frame.turns)
    first = next(f for f in geometry.picture.frames if coordinate in (f.slides, f.turns))
    moves = coordinate >= 0 and frame is first
    name = quoteattr(geometry.joints[coordinate] if moves else frame.name)
    kind, motion = "fixed", list[str]()
    if frame.slides >= 0:
        kind, motion = "prismatic", ['<axis xyz="1 0 0"/>', _NO_LIMIT]
    elif frame.turns >= 0:
        kind, motion = "continuous", [f'<axis xyz="0 {"1" if frame.sense > 0.0 else "-1"} 0"/>']
    links = [f'<parent link="{_link(frame.on)}"/>', f'<child link="{_link(frame.name)}"/>']
    lines = "".join(f"    {line}\n" for line in (_origin(*frame.at), *links, *motion) if line)
    return f'  <joint name={name} type="{kind}">\n{lines}  </joint>\n'


_NO_LIMIT = '<limit lower="-1000000.0" upper="1000000.0" effort="0.0" velocity="1000000.0"/>'


def _origin(right: float, up: float, angle: float = 0.0) -> str:
    """Return an origin; nothing where there is none to tell."""
    x, z, turn = (repr(value) if value else "0" for value in (right, up, angle))
    turned = f' rpy="0 {turn} 0"' if angle else ""
    return f'<origin xyz="{x} 0 {z}"{turned}/>' if right or up or angle else ""


def _solids(visual: Visual) -> Iterator[str]:
    """Yield a disc as a sphere, or a bar as a cylinder between each two points."""
    radius, color = repr(visual.size / 2.0), "grey" if visual.role == BASE else "blue"
    ends = visual.points if len(visual.points) > 1 else visual.points * 2
    for (x, z), (u, w) in pairwise(ends):
        length = sqrt((u - x) * (u - x) + (w - z) * (w - z))
        solid = (
            f'cylinder radius="{radius}" length="{length!r}"'
            if length
            else f'sphere radius="{radius}"'
        )
        parts = [f"<geometry><{solid}/></geometry>", f'<material name="{color}"/>']
        if origin := _origin((x + u) / 2.0, (z + w) / 2.0, atan2(u - x, w - z)):
            lines = "".join(f"      {part}\n" for part in (origin, *parts))
            yield f"    <visual>\n{lines}    </visual>\n"
        else:
            yield f"    <visual>{''.join(parts)}</visual>\n"


def _material(name: str, color: Color) -> str:
    rgba = " ".join(f"{part:g}" for part in color)
    return f'  <material name="{name}"><color rgba="{rgba}"/></material>'


def markers(drawn: Sequence[Shape], stamp_ns: int, frame: str = WORLD) -> bytes:
    """Return some shapes as visualization_msgs/MarkerArray; one without points is deleted."""
    content = [_marker(shape, _header(stamp_ns, frame)) for shape in drawn]
    return serialize(MARKER_ARRAY_TYPE, build(MARKER_ARRAY_TYPE, markers=content))


def transforms(geometry: Geometry, x: float, theta: float, stamp_ns: int) -> bytes:
    """Return the links' places as tf2_msgs/TFMessage, for the two coordinates in m or rad.

    Each in the link it is on: where it has slid to, at its track's height, turned about y from z towards x.
    """
    picture = geometry.picture
    local = [(frame, local_pose(picture, frame, (x, theta))) for frame in picture.frames]
    links = [
        {
            "header": _header(stamp_ns, _link(frame.on)),
            "child_frame_id": _link(frame.name),
            "transform": {
                "translation": _xyz((pose.x, 0.0, pose.z)),
                "rotation": {"y": sin(pose.angle / 2.0), "w": cos(pose.angle / 2.0)},
            },
        }
        for frame, pose in local
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
