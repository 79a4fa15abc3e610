"""A recorded run's controllers and disturbances recomputed: each command from the recorded states.

The record drives the same pure functions that the nodes compose; a parameter change or a reset takes
effect where the record says that it did. Compiled code (`stretches`) skips long stretches in which all
is equal; where something is not, this module checks step by step.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import NamedTuple

import numpy as np

from trunk_control.controller import Controller, hip_index, hip_seen
from trunk_control.decide import Answer, Reading, state_record
from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.with_arrays import with_arrays
from trunk_sim.disturbances import Disturbance, disturbance_at, disturbance_sample

from ..plans.timeline import Timeline, begins_active
from ..recorded.joint_table import JointTable
from ..recorded.run import RecordedRun
from . import stretches
from .bits import same

WORTH_COMPILING = 20_000  # steps: fewer are computed before compiled code would be loaded
# What a difference may be besides a value.
ACTIVE_CONTROLLERS = "active controllers"
MISSING = "missing"
UNEXPECTED = "unexpected"


class Difference(NamedTuple):
    """One value in which record and computation differ."""

    stamp_ns: int
    topic: str
    field: str
    recorded: float
    computed: float


class Checked(NamedTuple):
    """Steps of a replay: one and its differences, or many without any."""

    stamp_ns: int  # of the first
    found: Sequence[Difference]
    steps: int = 1
    controller: str = ""  # who was to send the command; empty: not exactly one
    last_ns: int | None = None  # stamp of the last step, where there are many


def compare(
    table: JointTable, stamp_ns: int, quantity: str, computed: Sequence[float]
) -> Iterator[Difference]:
    """Yield each value of a message whose bits are not the computed ones."""
    recorded = table.get(stamp_ns, quantity, len(computed))
    for name, was, now in zip(table.names, recorded, computed, strict=True):
        if not same(was, now):
            yield Difference(stamp_ns, table.topic, f"{quantity}[{name}]", was, now)


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

    def record(self, commands: JointTable, stamps: Integers) -> CommandWindows:
        """Return the record for `pass_over`, a row for each of the commands with these stamps."""
        rows = (table.rows_of(stamps) for table in (commands, self.states, self.terms))
        return CommandWindows(self, commands, stamps, *rows)

    def pass_over(self, record: CommandWindows, first: int, last: int) -> int:
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


class CommandWindows:
    """The record of a controller's commands for compiled code, so many rows at a time."""

    def __init__(
        self,
        driven: DrivenController,
        commands: JointTable,
        stamps: Integers,
        rows: Integers,
        state_rows: Integers,
        terms_rows: Integers,
    ) -> None:
        """``rows``, ``state_rows`` and ``terms_rows`` [N] are those of each command, -1 for none."""
        self._driven, self._commands, self._stamps = driven, commands, stamps
        self._rows, self._state_rows, self._terms_rows = rows, state_rows, terms_rows
        self._begin = -1
        self._window: stretches.CommandRecord

    def around(self, row: int) -> tuple[int, stretches.CommandRecord]:
        """Return where the window with a command begins, and its record."""
        begin = row - row % stretches.LONGEST
        if begin != self._begin:
            self._begin, self._window = begin, self._record(slice(begin, begin + stretches.LONGEST))
        return begin, self._window

    def _record(self, window: slice) -> stretches.CommandRecord:
        stamps, states, terms = (
            array[window] for array in (self._stamps, self._state_rows, self._terms_rows)
        )
        told = terms[terms >= 0]
        first, stop = (int(told.min()), int(told.max()) + 1) if len(told) else (0, 0)
        return stretches.CommandRecord(
            stamps,
            self._commands.values("effort")[self._rows[window], 0],
            np.where(states >= 0, np.arange(len(states)), -1),
            np.where(terms >= 0, terms - first, -1),
            self._driven.states_at(np.maximum(states, 0)),
            np.ascontiguousarray(self._driven.terms.positions(first, stop)),
        )


def _finite(value: float) -> float:
    """Return what a node takes for a value that nobody measured."""
    return value if isfinite(value) else 0.0


def worth_compiling(stamps: Integers, cost: int = 1) -> bool:
    """Return True if compiled code is there, is worthwhile, and takes these stamps: they ascend.

    ``cost``: of a step, in that of a controller's.
    """
    long = len(stamps) * cost >= WORTH_COMPILING and stretches.available()
    return long and bool((stamps[1:] > stamps[:-1]).all())


def judged(stamps: Integers, until_ns: int | None) -> Integers:
    """Return the stamps up to the last one to be judged."""
    if until_ns is None:
        return stamps
    beyond = np.flatnonzero(stamps > until_ns)
    return stamps[: beyond[0]] if len(beyond) else stamps


def replay_controllers(
    run: RecordedRun, driven: Mapping[str, DrivenController], until_ns: int | None = None
) -> Iterator[Checked]:
    """Yield what differs in each recorded command, and in its terms.

    In real time a controller acted on those states that its commands answer.
    """
    commands = run.table(topics.EFFORT_COMMAND)
    # A file does not keep the order between publishers.
    stamps = judged(np.sort(commands.stamp_ns), until_ns)
    records = _records(driven, commands, stamps)
    row = 0
    while row < len(stamps):
        stamp_ns = int(stamps[row])
        active = [node for node, one in driven.items() if one.turn(stamp_ns)]
        if len(active) != 1:
            count = float(len(active))
            yield Checked(stamp_ns, [Difference(stamp_ns, "", ACTIVE_CONTROLLERS, count, 1.0)])
            row += 1
            continue
        name = active[0]
        if name in records:
            change_ns = min(one.timeline.next_ns for one in driven.values())
            last = int(np.searchsorted(stamps, change_ns, side="right"))
            last = min(last, row + stretches.LONGEST)
            passed = driven[name].pass_over(records[name], row, last) - row
            if passed:
                row += passed
                yield Checked(stamp_ns, (), passed, name, int(stamps[row - 1]))
                continue
        yield Checked(stamp_ns, _compared(commands, driven[name], stamp_ns), controller=name)
        row += 1


def _records(
    driven: Mapping[str, DrivenController], commands: JointTable, stamps: Integers
) -> dict[str, CommandWindows]:
    """Return the records for compiled code; none if that is not worthwhile or not possible."""
    if not worth_compiling(stamps):
        return {}
    return {
        name: one.record(commands, stamps)
        for name, one in driven.items()
        if _is_whole(one.states, 2)
        and commands.widths["effort"] == 1
        and one.terms.widths["position"] == len(one.controller.law.record_names)
    }


def _is_whole(table: JointTable, joints: int) -> bool:
    return all(table.widths[q] == joints for q in ("position", "velocity", "effort"))


def _compared(commands: JointTable, driven: DrivenController, stamp_ns: int) -> list[Difference]:
    state = driven.state(stamp_ns)
    if state is None:
        return [Difference(stamp_ns, topics.JOINT_STATES, MISSING, 0.0, 0.0)]
    answer = driven.answer(stamp_ns)
    found = list(compare(commands, stamp_ns, "effort", (answer.effort,)))
    told = stamp_ns in driven.terms
    if answer.fresh and told:
        record = state_record(answer, state[0])
        found += compare(driven.terms, stamp_ns, "position", record)
    elif answer.fresh != told:
        what = MISSING if answer.fresh else UNEXPECTED
        found.append(Difference(stamp_ns, driven.terms.topic, what, 0.0, 0.0))
    return found


def replay_disturbance(run: RecordedRun, until_ns: int | None = None) -> Iterator[Checked]:
    """Yield what differs in each recorded disturbance."""
    timeline = run.timeline("disturbance")
    signals, joints = timeline.config.signals, timeline.config.joints
    messages = run.table(topics.DISTURBANCE)
    stamps = judged(messages.stamp_ns, until_ns)
    whole = all(messages.widths[q] == 2 for q in ("position", "effort"))
    quick = whole and worth_compiling(stamps)
    begin = -1
    matrix: Floats = np.empty((0, 4))
    row = 0
    while row < len(stamps):
        stamp_ns = int(stamps[row])
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        if quick:
            last = int(np.searchsorted(stamps, timeline.next_ns, side="right"))
            if row - row % stretches.LONGEST != begin:
                begin = row - row % stretches.LONGEST
                matrix = disturbances_matrix(messages, slice(begin, begin + stretches.LONGEST))
            last = min(last, begin + len(matrix)) - begin
            found_row = stretches.compiled_disturbances()(
                row - begin, last, with_arrays(signals), stamps[begin:], matrix
            )
            passed = begin + found_row - row
            if passed:
                row += passed
                yield Checked(stamp_ns, (), passed, last_ns=int(stamps[row - 1]))
                continue
        sample = disturbance_sample(stamp_ns, joints, disturbance_at(stamp_ns, signals))
        found = [
            *compare(messages, stamp_ns, "position", sample.position),
            *compare(messages, stamp_ns, "effort", sample.effort),
        ]
        yield Checked(stamp_ns, found)
        row += 1


def disturbances_matrix(messages: JointTable, rows: slice | Integers) -> Floats:
    """Return some recorded disturbances [N, 4], in the order of the channels."""
    return np.hstack([messages.values("effort")[rows], messages.values("position")[rows]])


def acting_at(disturbances: JointTable, stamp_ns: int) -> Disturbance:
    """Return the recorded disturbance at a stamp; none without a message."""
    if stamp_ns not in disturbances:
        return Disturbance()
    force, torque = disturbances.get(stamp_ns, "effort", 2)
    hip, trunk = disturbances.get(stamp_ns, "position", 2)
    return Disturbance(force, torque, hip, trunk)
