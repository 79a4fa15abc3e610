"""`JointSample`: the content of a sensor_msgs/JointState, free of ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence


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


def has_doubled(names: Sequence[str]) -> bool:
    """Return whether a name appears twice: neither nodes nor readers guess which of the values is meant."""
    return len(set(names)) < len(names)
