"""`Evidence`: which messages of a run count. `Rerun` judges these numbers."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_table import QUANTITIES, Floats, Integers, JointTable

from .inputs import RecordedInputs, most_steps
from .processes import Process, simulator_of

if TYPE_CHECKING:
    from .run import RecordedRun

_MOST_GAPS = 1000


class Evidence:
    """The states of one run of the plant: on the grid, ascending, without an impossible gap.

    ``stamps`` [N]: ns. ``index`` [N]: steps of the plant. ``spans``: rows [begin, end) without a gap.
    ``cut_ns``: stamp of the first state that cannot be placed, if there is one.
    """

    def __init__(self, run: RecordedRun) -> None:
        """Raise RecordingError and ParameterError for messages and parameters that cannot be used."""
        self.run, self.simulator = run, simulator_of(run)
        simulator = self.simulator
        self.truth, self.measured = (
            run.table(topic) for topic in (topics.GROUND_TRUTH, topics.JOINT_STATES)
        )
        # Of the states in their table; None: all of them. Large arrays are not made twice.
        self._rows = None if simulator.sent_all(self.truth) else simulator.rows(self.truth)
        self._measured = (
            None if simulator.sent_all(self.measured) else simulator.rows(self.measured)
        )
        self._period_ns = period_ns = simulator.config.period_ns
        stamps = simulator.stamps(self.truth)
        odd = (stamps < 0) | (stamps % period_ns != 0)
        odd[1:] |= np.diff(stamps) <= 0
        index = stamps // period_ns
        odd |= index > most_steps(len(stamps))
        gaps = np.flatnonzero(np.diff(index) != 1)
        odd[gaps[_MOST_GAPS:] + 1] = True
        end = int(np.argmax(odd)) if odd.any() else len(stamps)
        self.cut_ns: int | None = int(stamps[end]) if odd.any() else None
        self.stamps, self.index = stamps[:end], index[:end]
        begins = np.flatnonzero(np.diff(self.index, prepend=-2) != 1).tolist()
        self.spans = list(zip(begins, [*begins[1:], end][: len(begins)], strict=True))

    @cached_property
    def inputs(self) -> RecordedInputs:
        """What acted on the plant. Raises RecordingError for other messages."""
        return RecordedInputs(self.run, self.stamps)

    def row_at(self, stamp_ns: int) -> int | None:
        """Return the row of the state with a stamp; None if it is not on record."""
        row = int(np.searchsorted(self.stamps, stamp_ns))
        return row if row < len(self.stamps) and self.stamps[row] == stamp_ns else None

    def index_of(self, stamp_ns: int) -> int:
        """Return the index of the state with a stamp, on record or not."""
        return stamp_ns // int(self._period_ns)

    def true(self, first: int, stop: int) -> Floats:
        """Return true positions, velocities and efforts of the rows [first, stop): [n, 6]."""
        rows = np.arange(first, stop) if self._rows is None else self._rows[first:stop]
        return self._six(self.truth, rows)

    def measurements(self, stamps: Integers) -> Floats:
        """Return measured positions, velocities and efforts at these stamps [n, 6]; NaN without a record."""
        return self._six(self.measured, self.measured.rows_of(stamps, self._measured))

    def fell_before(self, row: int) -> bool:
        """Return True if the trunk fell before a state."""
        fall = self.run.fall
        return fall is not None and fall.stamp_ns < int(self.stamps[row])

    def _six(self, table: JointTable, rows: Integers) -> Floats:
        """Return both joints' positions, velocities and efforts [n, 6] in these rows, NaN in row -1."""
        values = np.full((len(rows), 6), np.nan)
        there = rows >= 0
        if not there.any():
            return values
        at = rows if there.all() else rows[there]
        for i, quantity in enumerate(QUANTITIES):
            recorded = table.values(quantity, 2)
            for joint, name in enumerate(self.simulator.config.joints):
                values[there, 2 * i + joint] = recorded[at, table.index(name)]
        return values


class RobotEvidence(Evidence):
    """The states that another robot published, in the order of their stamps: its plant is not computed."""

    def __init__(self, run: RecordedRun) -> None:
        """Take the states as the controllers read them. Raises RecordingError without one of their joints."""
        self.run = run
        processes = [process for name in run.judgeable for process in run.processes(name)]
        controllers = [process.config for process in processes if process.parameters]
        self.measured = run.table(topics.JOINT_STATES)
        self.stamps = np.unique(self.measured.stamp_ns)
        self.index = np.arange(len(self.stamps))
        self.spans, self.cut_ns = [(0, len(self.stamps))], None
        trunk = controllers[0].joint
        hip = next((config.hip for config in controllers if config.hip is not None), None)
        joints = "hip" if hip is None else hip, trunk
        self.simulator = Process("simulator", "", str(run.path), {"joints": joints})
        self._places = {1: self.measured.index(trunk)}
        if hip is not None:
            self._places[0] = self.measured.index(hip)

    def index_of(self, stamp_ns: int) -> int:
        """Return how many states come before a stamp."""
        return int(np.searchsorted(self.stamps, stamp_ns))

    def true(self, first: int, stop: int) -> Floats:
        """Return zeros [n, 6]: what is not known, and leads to nothing."""
        return np.zeros((stop - first, 6))

    def measurements(self, stamps: Integers) -> Floats:
        """Return hip and trunk as controllers read them [n, 6]: 0 where a node goes on without a value."""
        rows = self.measured.rows_of(stamps)
        values = np.zeros((len(stamps), 6))
        for i, quantity in enumerate(QUANTITIES):
            for joint, place in self._places.items() if self.measured.width(quantity) else ():
                values[:, 2 * i + joint] = self.measured.values(quantity)[rows, place]
        values[~np.isfinite(values)] = 0.0
        values[rows < 0] = np.nan
        return values
