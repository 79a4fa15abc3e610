"""Checks the answers to a state: a command's torque, a disturbance. Pure."""

from __future__ import annotations

from math import isfinite

from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.samples import JointSample

from .disturbances import Disturbance


class RefusedError(TrunkError):
    """The message is ignored; the text is the name under which it is counted."""


def effort_of(command: JointSample, joint: str) -> float:
    """Return a command's effort on a joint in N m. Raises RefusedError."""
    try:
        effort = command.effort[command.name.index(joint)]
    except (ValueError, IndexError):
        raise RefusedError("commands without the joint") from None
    if not isfinite(effort):
        raise RefusedError("commands not finite")
    return effort


def disturbance_of(sample: JointSample, joints: tuple[str, ...]) -> Disturbance:
    """Return the disturbance in a message, as `disturbance_sample` makes it. Raises RefusedError."""
    if sample.name != joints or not len(sample.effort) == len(sample.position) == 2:
        raise RefusedError("disturbances malformed")
    values = (*sample.effort, *sample.position)
    if not all(map(isfinite, values)):
        raise RefusedError("disturbances not finite")
    return Disturbance(*values)
