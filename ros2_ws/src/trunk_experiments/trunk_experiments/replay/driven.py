"""A recorded run's controllers as the record drives them: each with the states that it saw."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from trunk_control.controller import Controller, hip_index, hip_seen
from trunk_control.decide import Answer, Reading
from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.with_arrays import with_arrays

from ..plans.timeline import Timeline, begins_active
from ..recorded.joint_table import JointTable
from ..recorded.run import RecordedRun
from . import stretches
from .windows import Windows


class DrivenController:
    """A recorded controller, driven by its recorded states, changes and turns."""

    def __init__(self, run: RecordedRun, node: str) -> None:
        """Raise KeyError if its parameters were not recorded, RecordingError if no states were."""
        self.states = run.table(topics.JOINT_STATES)
        self.terms = run.table(topics.controller_state(node))
        config, changes = run.config(node), run.changes(node)
        self.timeline = Timeline(config, changes, self._seen)
        self.controller = Controller(config)
        if not begins_active(config, changes):
            self.controller.deactivate()
        self.joint = self.states.index(config.joint)
        self.hip = hip_index(config, self.states.names)

    def _seen(self, stamp_ns: int) -> float | None:
        if stamp_ns not in self.states:
            return None
        return self.states.get(stamp_ns, "position")[self.joint]

    def state(self, stamp_ns: int) -> tuple[float, float] | None:
        """Return the measured angle and rate at a stamp; None if that state was not recorded."""
        if stamp_ns not in self.states:
            return None
        position, velocity = (self.measured(stamp_ns, q) for q in ("position", "velocity"))
        return position[self.joint], velocity[self.joint]

    @property
    def _needs_velocity(self) -> bool:
        uses: bool = self.timeline.config.uses_rate
        return uses

    def measured(self, stamp_ns: int, quantity: str) -> Sequence[float]:
        """Return a quantity of a state, zeros where the node went on without it."""
        needed = quantity == "position" or (quantity == "velocity" and self._needs_velocity)
        if not needed and not self.states.values(quantity).shape[1]:
            return [0.0] * len(self.states.names)
        return self.states.get(stamp_ns, quantity)

    def states_at(self, rows: Integers) -> Floats:
        """Return what a controller reads of some rows of the states [N, 5], as `CommandRecord` has it."""
        position, velocity, effort = (
            self.states.values(quantity)[rows, self.joint]
            for quantity in ("position", "velocity", "effort")
        )
        hip: list[Floats] = [np.zeros(len(rows))] * 2
        if self.hip is not None:
            hip = [
                self.states.values(quantity)[rows, self.hip]
                for quantity in ("position", "velocity")
            ]
        if not self._needs_velocity:
            velocity = np.where(np.isfinite(velocity), velocity, 0.0)
        effort = np.where(np.isfinite(effort), effort, 0.0)
        return np.column_stack([position, velocity, *hip, effort])

    def record(self, commands: JointTable, stamps: Integers) -> Windows[stretches.CommandRecord]:
        """Return the record for `pass_over`, a row for each of the commands with these stamps."""
        # Which row of each table a command belongs to, -1 for none.
        rows, state_rows, terms_rows = (
            table.rows_of(stamps) for table in (commands, self.states, self.terms)
        )

        def record(window: slice) -> stretches.CommandRecord:
            states, terms = state_rows[window], terms_rows[window]
            told = terms[terms >= 0]
            first, stop = (int(told.min()), int(told.max()) + 1) if len(told) else (0, 0)
            return stretches.CommandRecord(
                stamps[window],
                commands.values("effort")[rows[window], 0],
                np.where(states >= 0, np.arange(len(states)), -1),
                np.where(terms >= 0, terms - first, -1),
                self.states_at(np.maximum(states, 0)),
                np.ascontiguousarray(self.terms.positions(first, stop)),
            )

        return Windows(record)

    def pass_over(self, record: Windows[stretches.CommandRecord], first: int, last: int) -> int:
        """Skip commands that are as recorded; return the first row that needs a closer look."""
        controller = self.controller
        begin, window = record.around(first)
        row, controller.memory = stretches.compiled_commands(controller.law.name)(
            first - begin,
            min(last - begin, len(window.stamp_ns)),
            controller.memory,
            with_arrays(controller.setting),
            tuple(with_arrays(one) for one in controller.constants),
            window,
        )
        return begin + row

    def turn(self, stamp_ns: int) -> bool:
        """Advance to a stamp; return True if the controller is active there."""
        self.timeline.advance(stamp_ns, self.controller)
        return self.controller.active

    def answer(self, stamp_ns: int) -> Answer:
        """Return the active controller's answer to a recorded state."""
        positions, velocities, efforts = (
            self.measured(stamp_ns, q) for q in ("position", "velocity", "effort")
        )
        told = stamp_ns in self.terms
        return self.controller.decide(
            Reading(
                stamp_ns,
                positions[self.joint],
                velocities[self.joint] if self._needs_velocity else _finite(velocities[self.joint]),
                hip_seen(self.hip, positions, velocities),
                _finite(efforts[self.joint]),
                told,
                self.terms.get(stamp_ns, "position")[0] if told else 0.0,
            )
        )


def driven_controllers(run: RecordedRun) -> dict[str, DrivenController]:
    """Return all controllers of a run by name. Raises as `DrivenController` does."""
    return {node: DrivenController(run, node) for node in run.controllers}


def _finite(value: float) -> float:
    """Return what a node uses in place of a value that was not measured."""
    return value if isfinite(value) else 0.0
