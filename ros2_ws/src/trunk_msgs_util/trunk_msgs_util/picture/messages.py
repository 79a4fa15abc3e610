"""The messages of a picture, as CDR: what RViz's and Foxglove's 3-D views draw.

``markers``: the shapes. ``robot_description`` and ``tf``: a URDF, and where its links are. A viewer needs the
transforms: the URDF's joints know nothing of the path's height, and a viewer may not read joint states.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..elementary import cos, sin
from ..recording.schemas import build, serialize
from ..topics import MARKER_ARRAY_TYPE, STRING_TYPE, TF_TYPE
from ..units import NANOSECONDS
from .shapes import Geometry, Kind, Point, Shape

WORLD, HIP_LINK, TRUNK_LINK = "world", "hip_link", "trunk_link"

_MARKER = "visualization_msgs/msg/Marker"
_ADD, _DELETE = 0, 2
_NO_TIME = {"sec": 0, "nanosec": 0}


def markers(shapes: Sequence[Shape], stamp_ns: int, frame: str = WORLD) -> bytes:
    """Return the shapes as visualization_msgs/MarkerArray; one without points is deleted."""
    array = build(MARKER_ARRAY_TYPE, markers=[_marker(shape, stamp_ns, frame) for shape in shapes])
    return serialize(MARKER_ARRAY_TYPE, array)


def transforms(geometry: Geometry, x: float, theta: float, stamp_ns: int) -> bytes:
    """Return the links' places as tf2_msgs/TFMessage, for a hip at x [m] and an angle theta [rad].

    ::

        hip_link in world         (x, 0, A sin(k x))
        trunk_link in hip_link    turned by theta about y: a rotation from z towards x
    """
    turned = _quaternion(0.0, sin(theta / 2.0), 0.0, cos(theta / 2.0))
    links = [
        _transform(stamp_ns, WORLD, HIP_LINK, geometry.hip(x), _quaternion(0.0, 0.0, 0.0, 1.0)),
        _transform(stamp_ns, HIP_LINK, TRUNK_LINK, (0.0, 0.0, 0.0), turned),
    ]
    return serialize(TF_TYPE, build(TF_TYPE, transforms=links))


def description(text: str) -> bytes:
    """Return a URDF as std_msgs/String."""
    return serialize(STRING_TYPE, build(STRING_TYPE, data=text))


def _marker(shape: Shape, stamp_ns: int, frame: str) -> Any:
    drawn = bool(shape.points)
    size = shape.size if drawn else 0.0
    scale, place, points = _vector(size, 0.0, 0.0), (0.0, 0.0, 0.0), shape.points
    if drawn and shape.kind is Kind.SPHERE:
        scale, place, points = _vector(size, size, size), shape.points[0], ()
    elif drawn and shape.kind is Kind.ARROW:  # the head's diameter and length
        scale = _vector(size, 2.5 * size, 3.0 * size)
    red, green, blue, alpha = shape.color if drawn else (0.0, 0.0, 0.0, 0.0)
    return build(
        _MARKER,
        header=_header(stamp_ns, frame),
        ns=shape.name,
        id=0,
        type=int(shape.kind),
        action=_ADD if drawn else _DELETE,
        pose=build(
            "geometry_msgs/msg/Pose",
            position=_point(place),
            orientation=_quaternion(0.0, 0.0, 0.0, 1.0 if drawn else 0.0),
        ),
        scale=scale,
        color=build("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=build("builtin_interfaces/msg/Duration", **_NO_TIME),
        frame_locked=False,
        points=[_point(point) for point in points],
        colors=[],
        texture_resource="",
        texture=build(
            "sensor_msgs/msg/CompressedImage",
            header=build(
                "std_msgs/msg/Header",
                stamp=build("builtin_interfaces/msg/Time", **_NO_TIME),
                frame_id="",
            ),
            format="",
            data=_NO_BYTES,
        ),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=build("visualization_msgs/msg/MeshFile", filename="", data=_NO_BYTES),
        mesh_use_embedded_materials=False,
    )


_NO_BYTES = np.zeros(0, np.uint8)


def _header(stamp_ns: int, frame: str) -> Any:
    sec, nanosec = divmod(stamp_ns, NANOSECONDS)
    stamp = build("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return build("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _transform(stamp_ns: int, parent: str, child: str, at: Point, turned: Any) -> Any:
    return build(
        "geometry_msgs/msg/TransformStamped",
        header=_header(stamp_ns, parent),
        child_frame_id=child,
        transform=build("geometry_msgs/msg/Transform", translation=_vector(*at), rotation=turned),
    )


def _point(at: Point) -> Any:
    return build("geometry_msgs/msg/Point", x=at[0], y=at[1], z=at[2])


def _vector(x: float, y: float, z: float) -> Any:
    return build("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _quaternion(x: float, y: float, z: float, w: float) -> Any:
    return build("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
