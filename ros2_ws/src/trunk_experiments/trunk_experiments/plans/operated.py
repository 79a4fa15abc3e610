"""What an operator did in a recorded run, step by step."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_sim.operator_input import NOTHING, Applied

Changes = Sequence[tuple[int, Applied]]  # from a stamp [ns] on, ascending


class Operated:
    """A run's operator: each change holds until the next one."""

    def __init__(self, changes: Changes) -> None:
        self.changes = tuple(changes)
        self._stamps = [stamp_ns for stamp_ns, _ in changes]

    def __bool__(self) -> bool:
        """Return True if there was one."""
        return bool(self.changes)

    def at(self, stamp_ns: int) -> Applied:
        """Return what acts on the step from the state with this stamp."""
        row = bisect_right(self._stamps, stamp_ns) - 1
        return self.changes[row][1] if row >= 0 else NOTHING

    def over(self, stamps: Integers) -> Floats:
        """Return what acts on the steps from these states [N, 2]: N and N m."""
        rows = np.searchsorted(self._stamps, stamps, side="right")
        return np.array([NOTHING, *(applied for _, applied in self.changes)])[rows]
