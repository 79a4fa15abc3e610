"""The torque over each step of a recorded run, as the record shows it.

Where time is exact, it is the command for the step's first state, or the one that a link delivered there. In
real time it is the one that the next true state records.
"""

from __future__ import annotations

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Floats

from ..recorded.run import RecordedRun
from ..recorded.wire import RecordedWire
from .plant_columns import by_row, filled, held
from .plant_states import RecordedStates


class RecordedTorques:
    """Torques in N m, one step's or many steps' at once."""

    def __init__(self, run: RecordedRun, states: RecordedStates, wire: RecordedWire) -> None:
        self._exact = run.exact
        self._truth = run.table(topics.GROUND_TRUTH)
        self._commands = run.table(topics.EFFORT_COMMAND)
        self._held = held(run, self._commands)
        self._states = states
        self._wire = wire

    def over(self, row: int) -> float | None:
        """Return the torque over the step from a row's state to the next row's; None if it is not known."""
        if self._exact:
            told_ns = self._wire.told_ns(int(self._states.stamps[row]))
            return self.command(told_ns) if told_ns >= 0 else 0.0
        return self._states.effort(row + 1)

    def command(self, stamp_ns: int) -> float | None:
        """Return the command for a state, or the torque held where no controller is to answer it."""
        told = stamp_ns in self._commands
        return self._commands.get(stamp_ns, "effort")[0] if told else self._held.get(stamp_ns)

    def over_all(self, first: int, stop: int) -> Floats:
        """Return the torques over the steps from the rows in [first, stop), NaN where not known."""
        stamps = self._states.stamps[first:stop]
        if self._exact:
            told = self._wire.all_told_ns(stamps)
            efforts, rows = self._commands.values("effort"), self._commands.rows_of(told)
            torques = np.ascontiguousarray(filled(efforts, rows)[:, 0])
            for stamp_ns, effort in self._held.items():
                torques[told == stamp_ns] = effort
            torques[told < 0] = 0.0
            return torques
        acted = by_row(self._truth, self._states.stamps[first + 1 : stop])[:, -1]
        return np.append(acted, np.nan)  # no step from the last row is asked for
