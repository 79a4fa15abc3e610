"""Contents of messages, free of ROS: `JointSample`, of a sensor_msgs/JointState; `Value`, of a parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

# What a parameter may hold, in a node, a file or a recording.
Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]


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
