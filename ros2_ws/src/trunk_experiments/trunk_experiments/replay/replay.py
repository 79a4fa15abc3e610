"""A recorded run's controllers and disturbances recomputed: each command from the recorded states.

The record drives the same pure functions that the nodes compose; a parameter change or a reset takes
effect where the record says that it did. Compiled code (`stretches`) skips long stretches in which all
is equal; where something is not, this module checks step by step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from math import isfinite
from typing import NamedTuple

import numpy as np

from trunk_control.controller import Controller, hip_index, hip_seen
from trunk_control.decide import Answer, Reading, state_record
from trunk_msgs_util import topics
from trunk_msgs_util.compiled import with_arrays
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
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
        position, velocity = (self._measured(stamp_ns, q) for q in ("position", "velocity"))
        return position[self.joint], velocity[self.joint]

    @property
    def _needs_velocity(self) -> bool:
        uses: bool = self.timeline.config.uses_rate
        return uses

    def _measured(self, stamp_ns: int, quantity: str) -> Sequence[float]:
        """Return a quantity of a state, zeros where the node went on without it."""
        needed = quantity == "position" or (quantity == "velocity" and self._needs_velocity)
        if not needed and not self.states.values(quantity).shape[1]:
            return [0.0] * len(self.states.names)
        return self.states.get(stamp_ns, quantity)

    @cached_property
    def _states_matrix(self) -> Floats:
        position, velocity, effort = (
            self.states.values(quantity)[:, self.joint]
            for quantity in ("position", "velocity", "effort")
        )
        hip: list[Floats] = [np.zeros(len(self.states))] * 2
        if self.hip is not None:
            hip = [
                self.states.values(quantity)[:, self.hip] for quantity in ("position", "velocity")
            ]
        if not self._needs_velocity:
            velocity = np.where(np.isfinite(velocity), velocity, 0.0)
        effort = np.where(np.isfinite(effort), effort, 0.0)
        return np.column_stack([position, velocity, *hip, effort])

    def record(self, commands: JointTable, stamps: Integers) -> stretches.CommandRecord:
        """Return the record for `pass_over`, a row for each of the commands with these stamps."""
        return stretches.CommandRecord(
            stamps,
            np.ascontiguousarray(commands.values("effort")[commands.rows_of(stamps), 0]),
            self.states.rows_of(stamps),
            self.terms.rows_of(stamps),
            self._states_matrix,
            np.ascontiguousarray(self.terms.values("position")),
        )

    def pass_over(self, record: stretches.CommandRecord, first: int, last: int) -> int:
        """Skip commands that are as recorded; return the first row that needs a closer look."""
        controller = self.controller
        row, controller.memory = stretches.compiled_commands(controller.law.name)(
            first,
            last,
            controller.memory,
            with_arrays(controller.setting),
            tuple(with_arrays(one) for one in controller.constants),
            record,
        )
        return row

    def turn(self, stamp_ns: int) -> bool:
        """Advance to a stamp; return True if the controller is active there."""
        self.timeline.advance(stamp_ns, self.controller)
        return self.controller.active

    def answer(self, stamp_ns: int) -> Answer:
        """Return the active controller's answer to a recorded state."""
        positions, velocities, efforts = (
            self._measured(stamp_ns, q) for q in ("position", "velocity", "effort")
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


def _finite(value: float) -> float:
    """Return what a node takes for a value that nobody measured."""
    return value if isfinite(value) else 0.0


def judged(stamps: Integers, until_ns: int | None) -> Integers:
    """Return the stamps up to the last one to be judged."""
    if until_ns is None:
        return stamps
    beyond = np.flatnonzero(stamps > until_ns)
    return stamps[: beyond[0]] if len(beyond) else stamps


def replay_controllers(
    run: RecordedRun, nodes: Sequence[str], until_ns: int | None = None
) -> Iterator[Checked]:
    """Yield what differs in each recorded command, and in its terms.

    In real time a controller acted on those states that its commands answer.
    """
    driven = {node: DrivenController(run, node) for node in nodes}
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
    driven: dict[str, DrivenController], commands: JointTable, stamps: Integers
) -> dict[str, stretches.CommandRecord]:
    """Return the records for compiled code; none if that is not worthwhile or not possible."""
    if len(stamps) < WORTH_COMPILING or not (np.diff(stamps) > 0).all():
        return {}
    return {
        name: one.record(commands, stamps)
        for name, one in driven.items()
        if _is_whole(one.states, 2)
        and commands.values("effort").shape[1] == 1
        and one.terms.values("position").shape[1] == len(one.controller.law.record_names)
    }


def _is_whole(table: JointTable, joints: int) -> bool:
    return all(table.values(q).shape[1] == joints for q in ("position", "velocity", "effort"))


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
    whole = all(messages.values(q).shape[1] == 2 for q in ("position", "effort"))
    quick = whole and len(stamps) >= WORTH_COMPILING and bool((np.diff(stamps) > 0).all())
    matrix = disturbances_matrix(messages) if quick else np.empty((0, 4))
    row = 0
    while row < len(stamps):
        stamp_ns = int(stamps[row])
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        if quick:
            last = int(np.searchsorted(stamps, timeline.next_ns, side="right"))
            last = min(last, row + stretches.LONGEST)
            passed = (
                stretches.compiled_disturbances()(row, last, with_arrays(signals), stamps, matrix)
                - row
            )
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


def disturbances_matrix(messages: JointTable) -> Floats:
    """Return recorded disturbances [N, 4], in the order of the channels."""
    return np.ascontiguousarray(np.hstack([messages.values("effort"), messages.values("position")]))


def acting_at(disturbances: JointTable, stamp_ns: int) -> Disturbance:
    """Return the recorded disturbance at a stamp; none without a message."""
    if stamp_ns not in disturbances:
        return Disturbance()
    force, torque = disturbances.get(stamp_ns, "effort", 2)
    hip, trunk = disturbances.get(stamp_ns, "position", 2)
    return Disturbance(force, torque, hip, trunk)
