"""A recorded run's plant in columns, window by window: what compiled stretches read."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from trunk_msgs_util import topics
from trunk_sim.noise import noise_samples
from trunk_sim.step import Plant

from ..recorded.run import RecordedRun
from ..recorded.wire import RecordedWire
from . import replay, stretches
from .plant_columns import by_row, is_whole
from .plant_states import RecordedStates
from .plant_torques import RecordedTorques
from .replay import disturbances_matrix


class PlantWindows:
    """The record around a row, and whether it is as compiled code takes it."""

    def __init__(
        self,
        run: RecordedRun,
        states: RecordedStates,
        torques: RecordedTorques,
        wire: RecordedWire,
        fell: Collection[int],
    ) -> None:
        """``fell``: the stamps at which the trunk fell by the events, ns."""
        self._truth = run.table(topics.GROUND_TRUTH)
        self._measured = run.table(topics.JOINT_STATES)
        self._commands = run.table(topics.EFFORT_COMMAND)
        self._disturbances = run.table(topics.DISTURBANCE)
        self._operated = run.operated
        self._seed: int = run.config("simulator").seed
        self._states, self._torques, self._wire = states, torques, wire
        self._fell = list(fell)
        self._number: tuple[int, bool] | None = None  # of the window that is held
        self._held: tuple[int, stretches.PlantRecord]

    def are_worthwhile(self, plant: Plant) -> bool:
        """Return True if compiled code is worthwhile, and the record is as it takes it."""
        states, disturbances = self._states, self._disturbances
        cost = max(plant.substeps // 2, 1)  # two Runge-Kutta steps take as long as a law
        return (
            all(is_whole(table) for table in (self._truth, self._measured))
            and replay.worth_compiling(states.stamps, cost)
            and np.array_equal(states.steps, np.arange(len(states)))
            and self._commands.widths["effort"] == 1
            and (
                not len(disturbances)
                or all(disturbances.widths[q] == 2 for q in ("position", "effort"))
            )
        )

    def around(self, row: int, noise: bool) -> tuple[int, stretches.PlantRecord]:
        """Return the first row of the window around a row, and its record, with or without noise.

        It goes on to the first row of the next window, to which its last step leads.
        """
        number = row // stretches.LONGEST, noise
        if self._number != number:
            first = number[0] * stretches.LONGEST
            # What is still to be seen of the past.
            begin = max(first - self._states.delay_steps - self._wire.oldest, 0)
            stop = min(first + stretches.LONGEST + 1, len(self._states))
            self._number, self._held = number, (begin, self._record(begin, stop, noise))
        return self._held

    def _record(self, first: int, stop: int, noise: bool) -> stretches.PlantRecord:
        """Return the record of the states in [first, stop)."""
        stamps = self._states.stamps[first:stop]
        disturbances = np.zeros((len(stamps), 4))
        if len(self._disturbances):
            rows = self._disturbances.rows_of(stamps)
            known = rows >= 0
            disturbances[known] = disturbances_matrix(self._disturbances, rows[known])
        if self._operated:
            applied = self._operated.over(stamps)
            acts = applied.any(axis=1)  # as `with_operator` adds it
            disturbances[acts, :2] += applied[acts]
        return stretches.PlantRecord(
            by_row(self._truth, stamps),
            by_row(self._measured, stamps),
            self._torques.over_all(first, stop),
            disturbances,
            np.isin(stamps, self._fell).astype(np.int64),
            noise_samples(self._seed, len(stamps), first) if noise else np.zeros((len(stamps), 2)),
            self._wire.seen(first, stop) - first,
        )
