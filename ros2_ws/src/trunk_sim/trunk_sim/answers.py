"""Checks the answers to a state: a command's torque, a disturbance. Pure."""

from __future__ import annotations

from math import isfinite

from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.samples import JointSample, has_doubled
from trunk_msgs_util.text import quoted_names

from .disturbances import Disturbance


class RefusedError(TrunkError):
    """The message is ignored; the text is what it is counted as, ``why`` its fault and the remedy."""

    def __init__(self, what: str, why: str = "") -> None:
        super().__init__(what)
        self.why = why


def effort_of(command: JointSample, joint: str) -> float:
    """Return a command's effort on a joint in N m. Raises RefusedError."""
    names = quoted_names(command.name)
    if joint not in command.name or has_doubled(command.name):
        raise RefusedError(
            "commands without the joint",
            f"their names are {names}: {joint!r} must be there, once, and no other name twice",
        )
    place = command.name.index(joint)
    if place >= len(command.effort):
        raise RefusedError(
            "commands without an effort",
            f"{len(command.effort)} values of effort for the names {names}: one for each is needed, in N m",
        )
    effort = command.effort[place]
    if not isfinite(effort):
        raise RefusedError("commands not finite", f"the effort of {joint!r} is {effort}, N m")
    return effort


def disturbance_of(sample: JointSample, joints: tuple[str, ...]) -> Disturbance:
    """Return the disturbance in a message, as `disturbance_sample` makes it. Raises RefusedError."""
    if sample.name != joints or not len(sample.effort) == len(sample.position) == 2:
        raise RefusedError(
            "disturbances malformed",
            f"the names must be {quoted_names(joints)}, with two values of effort and two of position; "
            f"they are {quoted_names(sample.name)}, with {len(sample.effort)} and {len(sample.position)}",
        )
    values = (*sample.effort, *sample.position)
    if not all(map(isfinite, values)):
        raise RefusedError("disturbances not finite", f"the values are {values}")
    return Disturbance(*values)
