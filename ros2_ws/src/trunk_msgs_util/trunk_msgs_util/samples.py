"""`JointSample`: the content of a sensor_msgs/JointState, free of ROS."""

from __future__ import annotations

from typing import NamedTuple


class JointSample(NamedTuple):
    """Named values at a stamp; an empty tuple means that the message does not carry that quantity.

    On joint topics: position [m, rad], velocity [m/s, rad/s], effort [N, N m]. On ``~/state`` the names
    are those of the terms, and the values are in ``position``.
    """

    stamp_ns: int
    name: tuple[str, ...]
    position: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    effort: tuple[float, ...] = ()
