"""What an operator does in a run, step by step."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_sim.operator_input import NOTHING, Applied, OperatorLimits

Pushes = Sequence[tuple[int, Applied]]  # what was taken, and at which stamp [ns], ascending


class Operated:
    """A run's operator: each push holds until the next one, or until it is too old."""

    def __init__(self, pushes: Pushes, limits: OperatorLimits | None) -> None:
        """``limits``: None where nobody may push; then nothing acts."""
        self.pushes = tuple(pushes) if limits is not None else ()
        self._limits = limits
        self._stamps = [stamp_ns for stamp_ns, _ in self.pushes]

    def __bool__(self) -> bool:
        """Return True if there was one."""
        return bool(self.pushes)

    def at(self, stamp_ns: int) -> Applied:
        """Return the push that acts on the step from the state with this stamp."""
        row = bisect_right(self._stamps, stamp_ns) - 1
        if row < 0 or self._limits is None:
            return NOTHING
        since_ns, asked = self.pushes[row]
        return self._limits.apply(asked, since_ns, stamp_ns)

    def over(self, stamps: Integers) -> Floats:
        """Return the pushes that act on the steps from these states [N, 2]: N and N m."""
        return np.array([self.at(stamp_ns) for stamp_ns in stamps.tolist()]).reshape(-1, 2)


@dataclass(frozen=True)
class RealTimeInputs:
    """What the wall clock decided in a real-time run: which message acted when, and who answered what.

    ``command_index`` [N]: the state whose command is in force, -1: none. ``disturbance`` [N, 4]: in force;
    ``disturbance_ns`` [N]: its stamp, -1: none. ``answered``: by controller, the stamps of the states that it
    answered. ``disturbed``: the stamps of the disturbance node's messages. ``seen``: the angle [rad] in each
    state before which a controller became active, by stamp.
    """

    command_index: Integers
    disturbance: Floats
    disturbance_ns: Integers
    answered: Mapping[str, Integers]
    disturbed: Integers
    seen: Mapping[int, float]
