"""What acts on the plant over a step, and who sent it: a row of ``plant/inputs``. Pure."""

from __future__ import annotations

from typing import NamedTuple

from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.source import frame_of_inputs
from trunk_msgs_util.topics import INPUT_NAMES

from .disturbances import Disturbance

_NONE_NS = -1


class Command(NamedTuple):
    """A command that the plant has taken: the state that it answers, its torque in N m, and its sender."""

    stamp_ns: int
    effort: float
    source: str


class Disturbed(NamedTuple):
    """A disturbance that the plant has taken: since when it acts, what it is, and its sender."""

    stamp_ns: int
    disturbance: Disturbance
    source: str


NO_COMMAND = Command(_NONE_NS, 0.0, "")
UNDISTURBED = Disturbed(_NONE_NS, Disturbance(), "")


def inputs_row(stamp_ns: int, command: Command, disturbed: Disturbed) -> JointSample:
    """Return what acts over the step from the state with this stamp, each value with its age in ns.

    The age is -1 where nothing is in force. It is a double, exact below 104 days.
    """
    age, since = (
        -1.0 if acting.stamp_ns < 0 else float(stamp_ns - acting.stamp_ns)
        for acting in (command, disturbed)
    )
    return JointSample(
        stamp_ns,
        INPUT_NAMES,
        (command.effort, *disturbed.disturbance),
        (age, since, since, since, since),
    )


def inputs_frame(simulator: str, command: Command, disturbed: Disturbed) -> str:
    """Return the frame of a row: the sources of the row, the command and the disturbance."""
    return frame_of_inputs(simulator, command.source, disturbed.source)
