"""The true and measured states of a recorded run, each true state placed on the grid of steps."""

from __future__ import annotations

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.joint_table import Floats, Integers, JointTable
from trunk_sim.plant import PlantState

from ..recorded.inputs import Bools, RecordedInputs
from ..recorded.processes import Process
from ..recorded.run import RecordedRun
from ..runs.schedule import Wire

QUANTITIES = ("position", "velocity", "effort")
_MOST_GAPS = 1000
_FAR = 100_000  # states beyond ten times those on record: no run has such a gap


class RecordedStates:
    """The states of one run of the plant: on the grid, ascending, without an impossible gap.

    ``stamps`` [N]: ns. ``index`` [N]: steps of the plant. ``spans``: rows [begin, end) without a gap.
    ``cut_ns``: stamp of the first state that cannot be placed, if there is one.
    """

    def __init__(self, run: RecordedRun, simulator: Process) -> None:
        self.truth, self.measured = (
            run.table(topic) for topic in (topics.GROUND_TRUTH, topics.JOINT_STATES)
        )
        # Of the states in their table; None: all of them. Large arrays are not made twice.
        self._rows = None if simulator.sent_all(self.truth) else simulator.rows(self.truth)
        self._measured = (
            None if simulator.sent_all(self.measured) else simulator.rows(self.measured)
        )
        self._fell = [e.stamp_ns for e in simulator.events if e.message == Event.FELL]
        self._delay_steps: int = simulator.config.delay_steps
        period_ns = simulator.config.period_ns
        stamps = simulator.stamps(self.truth)
        odd = (stamps < 0) | (stamps % period_ns != 0)
        odd[1:] |= np.diff(stamps) <= 0
        index = stamps // period_ns
        odd |= index > 10 * len(stamps) + _FAR
        gaps = np.flatnonzero(np.diff(index) != 1)
        odd[gaps[_MOST_GAPS:] + 1] = True
        end = int(np.argmax(odd)) if odd.any() else len(stamps)
        self.cut_ns: int | None = int(stamps[end]) if odd.any() else None
        self.stamps, self.index = stamps[:end], index[:end]
        begins = np.flatnonzero(np.diff(self.index, prepend=-2) != 1).tolist()
        self.spans = list(zip(begins, [*begins[1:], end][: len(begins)], strict=True))

    def row_at(self, stamp_ns: int) -> int | None:
        """Return the row of the state with a stamp; None if it is not on record."""
        row = int(np.searchsorted(self.stamps, stamp_ns))
        return row if row < len(self.stamps) and self.stamps[row] == stamp_ns else None

    def true(self, first: int, stop: int) -> Floats:
        """Return true positions, velocities and efforts of the rows [first, stop): [n, 6]."""
        rows = np.arange(first, stop) if self._rows is None else self._rows[first:stop]
        return six(self.truth, rows)

    def measurements(self, stamps: Integers) -> Floats:
        """Return measured positions, velocities and efforts at these stamps [n, 6]; NaN without a record."""
        return six(self.measured, self.measured.rows_of(stamps, self._measured))

    def plant_state(self, row: int) -> tuple[PlantState, float, bool]:
        """Return a state, the effort [N m] that led to it, and True if the trunk fell before it."""
        values = self.true(row, row + 1)[0].tolist()
        fallen = any(fell_ns < self.stamps[row] for fell_ns in self._fell)
        return PlantState(*values[:4]), values[5], fallen

    def falls(self, stamps: Integers) -> Floats:
        """Return 1.0 at the stamps of recorded falls, else 0.0 [n]."""
        return np.isin(stamps, self._fell).astype(float)

    def follows(
        self, rows: Integers, begin: int, inputs: RecordedInputs, wire: Wire | None
    ) -> Bools:
        """Return for which states of the span from row ``begin`` all that leads to them is on record."""
        before = rows - 1
        first = rows == begin
        before[first] = rows[first]
        known = inputs.disturbance_known[before]
        if wire is None:
            known = known & inputs.command_known[before]
        else:
            command = wire.used[self.index[before]]
            used = self._row_of(command, begin)
            there = (used >= begin) & inputs.command_known[np.maximum(used, 0)]
            known = known & (there | (command < 0))
        known[first] = self.index[rows[first]] == 0
        return known

    def seen(self, rows: Integers, begin: int, inputs: RecordedInputs, wire: Wire | None) -> Bools:
        """Return for which states of the span all that their measurement is made of is on record."""
        source = rows if wire is None else self._row_of(wire.seen[self.index[rows]], begin)
        inside = source >= begin
        if self.index[begin] > 0:
            inside &= source - self._delay_steps >= begin
        known: Bools = inside & inputs.disturbance_known[np.maximum(source, 0)]
        return known

    def _row_of(self, index: Integers, begin: int) -> Integers:
        """Return the rows of states of the span, by their indices."""
        return index - int(self.index[begin]) + begin


def six(table: JointTable, rows: Integers) -> Floats:
    """Return positions, velocities and efforts of two joints [n, 6] in these rows, NaN in row -1."""
    values = np.full((len(rows), 6), np.nan)
    there = rows >= 0
    if not there.any():
        return values
    at = rows if there.all() else rows[there]
    for i, quantity in enumerate(QUANTITIES):
        values[there, 2 * i : 2 * i + 2] = table.values(quantity, 2)[at]
    return values
