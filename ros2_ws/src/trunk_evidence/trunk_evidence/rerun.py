"""A recorded run, run again: the closed loop goes on from each recorded state, and is compared with the next.

    state k, inputs k      -> state k + 1        the plant
    state k, inputs k      -> measurement k      the sensors
    measurements, memory   -> command and terms  each controller

Each check has a span of its own. A gap, a lost message or a restart spoils the checks that need what is
missing, and no others. The plant of another robot is not computed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from math import nan
from typing import NamedTuple

import numpy as np

from trunk_control.controller import hip_index
from trunk_control.decide import Reading
from trunk_control.law import ControllerConfig
from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.arrays import Bools, Floats, Integers
from trunk_core.parameters.shared import RecorderConfig
from trunk_core.topics import Event
from trunk_core.units import seconds
from trunk_recording.joint_table import QUANTITIES, JointTable
from trunk_runs.engine import (
    ACTIVE,
    APPLIED,
    EFFORT,
    FRESH,
    POSITION,
    SEEN_APPLIED,
    SEEN_POSITION,
    SEEN_VELOCITY,
    TERMS,
    VELOCITY,
    Engine,
    RecordSource,
    States,
)
from trunk_runs.loop import Schedule, reading_of
from trunk_runs.plan import RunPlan
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.simulation import DivergedError
from trunk_sim.step import Measurement

from .recorded_run import RecordedRun
from .senders import Process, UnorderedError
from .verdict import (
    ACTIVE_CONTROLLERS,
    DIVERGED,
    MISSING,
    UNEXPECTED,
    Check,
    ComparedColumn,
    Difference,
)

_FIELDS = tuple((quantity, joint) for quantity in QUANTITIES for joint in (0, 1))
_TRUTH = [0, 1, 2, 3, 5]  # of the six fields: without the hip's effort

PLANT, SENSORS = "states of the plant", "measured states"
UNATTRIBUTED = "commands without one active controller"


class _Window(NamedTuple):
    """The record of a segment's states, as the loop is given it."""

    stamps: Integers
    truth: Floats  # [n, 6]: positions, velocities, efforts of hip and trunk
    measured: Floats  # [n, 6], likewise; NaN where it is missing
    commands: Integers  # [n], row of the recorded command, -1: none
    # Of each controller: whether there are terms [n], and which [n, K].
    terms: Sequence[tuple[Bools, Floats]]


class Answers:
    """A controller's process in a run, and the check of its commands and terms."""

    def __init__(self, run: RecordedRun, process: Process, period_ns: int) -> None:
        """``period_ns``: the plant's; 0 for another robot.

        Raises UnorderedError, and RecordingError for other messages.
        """
        self.process = process
        self.check = Check(f"commands of {process.node}")
        self.topic = topics.controller_state(process.node)
        self.lacking: Difference | None = None  # the first update without its terms
        commands, self._table = run.table(topics.EFFORT_COMMAND), run.table(self.topic)
        if len(self._table):
            self._table.check_width("position", len(law_named(process.node).record_names))
        # Rows of all commands and terms; None: they are all this process's.
        self._terms_rows = None if process.sent_all(self._table) else process.rows(self._table)
        self._terms_stamps = stamps = process.stamps(self._table)
        if (np.diff(stamps) <= 0).any():
            order = np.argsort(stamps, kind="stable")
            self._terms_rows = order if self._terms_rows is None else self._terms_rows[order]
            self._terms_stamps = stamps[order]
        self._rows = None if process.sent_all(commands) else process.rows(commands)
        self._stamps = process.stamps(commands)
        if not process.source and run.count(
            topics.PLANT_INPUTS
        ):  # a copy of a real-time run: its terms tell whose
            self._rows = np.flatnonzero(np.isin(self._stamps, self._terms_stamps))
            self._stamps = self._stamps[self._rows]
        self._known = True
        self._anew = list(_anew(process, period_ns))

    @property
    def idle(self) -> bool:
        """True for a process in real time of which no command is on record."""
        return bool(self.process.source) and not len(self._stamps)

    @property
    def last_ns(self) -> int:
        """The stamp of its last command on record, ns; -1 if there is none."""
        return int(self._stamps.max(initial=-1))

    def answered(self, stamps: Integers) -> Bools:
        """Return which states this process answered, by its own commands."""
        return np.isin(stamps, self._stamps)

    def last_update(self, stamp_ns: int) -> int:
        """Return the stamp of the last update up to a stamp, ns; -1 if there is none."""
        stamps = self._terms_stamps
        return int(stamps[stamps <= stamp_ns].max(initial=-1))

    def reference(self, stamp_ns: int) -> float:
        """Return the reference of the update with this stamp, rad; NaN if there is none."""
        there, values = self.terms_at(np.array([stamp_ns]))
        return float(values[0, 0]) if there[0] else nan

    def is_own(self, rows: Integers) -> Bools:
        """Return which of some commands, by their rows, are this process's."""
        return rows >= 0 if self._rows is None else np.isin(rows, self._rows)

    def terms_at(self, stamps: Integers) -> tuple[Bools, Floats]:
        """Return for which states there are terms, and which [n, K]; NaN where there are none."""
        known = self._terms_stamps
        values = np.full((len(stamps), len(self._table.names)), np.nan)
        there = np.zeros(len(stamps), bool)
        if not len(known):
            return there, values
        at = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
        there = known[at] == stamps
        rows = at[there] if self._terms_rows is None else self._terms_rows[at[there]]
        if len(rows):
            first = int(rows.min())
            values[there] = self._table.positions(first, int(rows.max()) + 1)[rows - first]
        return there, values

    def lose(self) -> None:
        """Note that states are missing: what the controller did in them is not known."""
        self._known = False

    def is_known(self, stamps: Integers, readable: Bools, mine: Bools) -> Bools:
        """Return for which states the controller's memory follows from the record.

        ``readable``: there is a measured state; ``mine``: those that it answered, or all in simulated time.
        """
        lost = ~readable & (mine | (self.process.source == ""))
        if self._known and not lost.any():
            self._begin_anew(int(stamps[-1]))
            return readable
        known = np.zeros(len(stamps), bool)
        for row, stamp_ns in enumerate(stamps.tolist()):
            self._known = (self._known or self._begin_anew(stamp_ns)) and not lost[row]
            known[row] = self._known
        return known

    def begins_known(self, stamp_ns: int) -> bool:
        """Return True if the controller's memory before the state with this stamp follows from the record."""
        self._known = self._known or self._begin_anew(stamp_ns)
        return self._known

    def _begin_anew(self, stamp_ns: int) -> bool:
        """Return True if the controller began from nothing since it was last asked, before this stamp."""
        before = len(self._anew)
        self._anew = [since_ns for since_ns in self._anew if since_ns >= stamp_ns]
        return len(self._anew) < before

    def take(
        self,
        stamps: Integers,
        mine: Bools,
        given: Bools,
        known: Bools,
        effort: ComparedColumn | None,
        terms: tuple[Bools, Floats],
        table: Floats,
    ) -> None:
        """Compare the commands that are ``given`` in the rows that are ``mine``, and their terms.

        ``table``: as `States` has it.
        """
        self.check.unjudged += int(np.count_nonzero(mine & ~given))
        mine = mine & given
        if effort is None or not mine.any():
            return
        (there, values), fresh = terms, table[:, FRESH] != 0.0
        judged = mine & known
        blank = ~(there & fresh)
        names = self._table.names
        columns = [effort]
        for i, name in enumerate(names):
            recorded, own = values[:, i].copy(), table[:, TERMS + i].copy()
            recorded[blank] = own[blank] = 0.0
            columns.append(ComparedColumn(self.topic, f"position[{name}]", recorded, own))
        self.check.take(stamps[mine], judged[mine], [_rows_of(column, mine) for column in columns])
        self.unexpected(stamps, judged & there & ~fresh)
        lacking = np.flatnonzero(judged & fresh & ~there)
        if len(lacking) and self.lacking is None:
            self.lacking = Difference(int(stamps[lacking[0]]), self.topic, MISSING, 0.0, 0.0)

    def unexpected(self, stamps: Integers, odd: Bools) -> None:
        """Note the first of the terms where none were to be sent."""
        for row in np.flatnonzero(odd)[:1].tolist():
            self.check.note(Difference(int(stamps[row]), self.topic, UNEXPECTED, 0.0, 0.0))


def _rows_of(column: ComparedColumn, rows: Bools) -> ComparedColumn:
    return column._replace(recorded=column.recorded[rows], computed=column.computed[rows])


def _anew(process: Process, period_ns: int) -> Iterator[int]:
    """Yield the stamps after which a controller starts from nothing, whatever it did before."""
    active = True
    for change in process.changes:
        if change.values is not None:
            continue
        begins = change.event == Event.RESET or (change.event == Event.ACTIVATED and not active)
        # A controller that joins a run under way begins just before the first state that it sees.
        joins = change.event == Event.ACTIVATED and change.stamp_ns > 0
        if begins or (joins and period_ns and (change.stamp_ns + 1) % period_ns == 0):
            yield change.stamp_ns
        active = change.event not in (Event.DEACTIVATED, Event.CLEANED_UP)


class Rerun:
    """A run from its first recorded state to the last that can be placed."""

    def __init__(self, run: RecordedRun) -> None:
        """Raise RecordingError and ParameterError for messages and parameters that cannot be used."""
        self.run = run
        self.evidence = run.evidence
        self.simulator, self.inputs = self.evidence.simulator, self.evidence.inputs
        period_ns = 0 if run.another_robot else self.simulator.config.period_ns
        self.plant, self.sensors = Check(PLANT), Check(SENSORS)
        self.unattributed = Check(UNATTRIBUTED)
        self.answers: dict[str, Answers] = {}
        self._refused: list[Check] = []
        for name in () if run.another_controller else run.judgeable:
            process = run.process(name)
            assert process is not None  # its parameters are on record
            try:
                self.answers[name] = Answers(run, process, period_ns)
            except UnorderedError as error:  # it was killed, say: the others can be judged
                self._refused.append(Check(f"commands of {name}", reason=str(error)))
        self._partial = self.inputs.recorded  # controllers did not get every state
        self._commands = run.table(topics.EFFORT_COMMAND)
        self._window: _Window | None = None
        self._span = 0, 0  # rows
        record = RecordSource(
            self._given,
            self._seen if self._partial else None,
            self.stamps if run.another_robot else None,
        )
        self.engine = Engine(self._plan, record)
        self._wire = self.engine.wire

    @property
    def stamps(self) -> Integers:
        """The stamps of the states, ns [N]."""
        return self.evidence.stamps

    @property
    def cut_ns(self) -> int | None:
        """The stamp of the first state that cannot be placed."""
        return self.evidence.cut_ns

    @property
    def checks(self) -> list[Check]:
        """All checks of what was run so far."""
        commands = [*(answers.check for answers in self.answers.values()), *self._refused]
        if self.run.another_robot:
            return commands
        unattributed = [self.unattributed] if self.unattributed.steps else []
        return [*commands, *unattributed, self.sensors, self.plant]

    @cached_property
    def _plan(self) -> RunPlan:
        config: SimulatorConfig = self.simulator.config
        last = int(self.evidence.index[-1]) if len(self.stamps) else 0
        return RunPlan(
            scenario=self.run.recording.provenance.get("scenario", ""),
            simulator=replace(config, duration=seconds(last * config.period_ns)),
            controllers={name: answers.process.config for name, answers in self.answers.items()},
            disturbance=None,
            recorder=RecorderConfig(),
            namespace=self.run.namespace,
            changes={
                "simulator": self.simulator.changes,
                **{name: answers.process.changes for name, answers in self.answers.items()},
            },
        )

    def compare(self, until_ns: int | None = None) -> None:
        """Run, and compare, up to a stamp, or to the end."""
        for begin, end in self.evidence.spans:
            stop = end
            if until_ns is not None:
                stop = begin + int(np.searchsorted(self.stamps[begin:end], until_ns, "right"))
            if stop > begin:
                self._compare_span(begin, stop)
            if stop < end:
                return

    def _compare_span(self, begin: int, end: int) -> None:
        self._span = begin, end
        index = int(self.evidence.index[begin])
        if begin or index:
            self._jump(begin, index)
            for answers in self.answers.values():
                answers.lose()
        stop = int(self.evidence.index[end - 1]) + 1
        while True:
            try:
                for states in self.engine.states(stop):
                    self._take(states)
                return
            except DivergedError:
                row = begin + self.engine.index - index
                if row >= end:
                    return
                self._note_divergence(row)
                self._jump(row, self.engine.index)

    def _note_divergence(self, row: int) -> None:
        angle = float(self.evidence.true(row, row + 1)[0, 1])
        stamp_ns = int(self.stamps[row])
        self.plant.note(Difference(stamp_ns, topics.GROUND_TRUTH, DIVERGED, angle, nan))

    def _jump(self, row: int, index: int) -> None:
        values = self.evidence.true(row, row + 1)[0].tolist()
        state = PlantState(*values[:4])
        self.engine.jump(index, state, values[5], self.evidence.fell_before(row))

    def run_to(self, name: str, stamp_ns: int) -> bool:
        """Run up to the state before a stamp; return True if the controller's memory is then known."""
        self.compare(stamp_ns - 1)
        index = self.evidence.index_of(stamp_ns)
        if self.engine.index != index:  # states before it are missing
            row = self.evidence.row_at(stamp_ns)
            if row is None:
                return False
            self._span = next(span for span in self.evidence.spans if span[0] <= row < span[1])
            self._jump(row, index)
            self.answers[name].lose()
        self.engine.take_effect()
        return self.answers[name].begins_known(stamp_ns)

    def reading(self, name: str, stamp_ns: int) -> Reading | None:
        """Return a measured state as a controller reads it; None if it is not on record."""
        values = self.evidence.measurements(np.array([stamp_ns]))[0]
        if np.isnan(values[0]):
            return None
        answers = self.answers[name]
        hip = hip_index(answers.process.config, self.simulator.config.joints)
        measured = Measurement(*values[:4].tolist())
        place = -1 if hip is None else hip
        reference = answers.reference(stamp_ns)
        return reading_of(stamp_ns, measured, float(values[5]), place, reference)

    def acting_at(self, stamp_ns: int) -> Disturbance:
        """Return the disturbance in force in a state; none in a state that is not on record."""
        row = self.evidence.row_at(stamp_ns)
        if row is None:
            return Disturbance()
        return Disturbance(*self.inputs.over(slice(row, row + 1)).disturbance[0].tolist())

    # The schedule of the loop.

    def _given(self, first: int, stop: int) -> Schedule:
        """Return the record of the states with indices in [first, stop), which are all there."""
        begin = self._span[0] + first - int(self.evidence.index[self._span[0]])
        rows = slice(begin, begin + stop - first)
        stamps = self.stamps[rows]
        truth = self.evidence.true(begin, begin + stop - first)
        measured = self.evidence.measurements(stamps)
        force = self.inputs.over(rows)
        terms = [answers.terms_at(stamps) for answers in self.answers.values()]
        commands = self._commands.rows_of(stamps)
        self._window = _Window(stamps, truth, measured, commands, terms)
        reads = None
        if self._partial:
            columns = [answers.answered(stamps) for answers in self.answers.values()]
            reads = np.ascontiguousarray(np.array(columns, np.int64).reshape(-1, len(stamps)).T)
        return Schedule(
            truth=truth[:, _TRUTH],  # such a selection is contiguous
            measured=measured[:, _TRUTH],
            disturbance=force.disturbance,
            command=force.command,
            push=self.run.operated.over(stamps) if self.run.operated else None,
            reference=_references(len(stamps), terms),
            reads=reads,
            stamp_ns=stamps if self.run.another_robot else None,
        )

    def _seen(self, name: str, stamp_ns: int) -> float | None:
        """Return the angle that a controller saw at a stamp, rad."""
        measured = self.evidence.measured
        if stamp_ns not in measured:
            return None
        config: ControllerConfig = self.answers[name].process.config
        return measured.get(stamp_ns, "position")[measured.index(config.joint)]

    # The comparison.

    def _take(self, states: States) -> None:
        window, count = self._window, len(states.table)
        assert window is not None  # for the type: the segment was given it
        window = _Window(
            window.stamps[:count],
            window.truth[:count],
            window.measured[:count],
            window.commands[:count],
            [(there[:count], values[:count]) for there, values in window.terms],
        )
        begin = self._span[0] + states.first - int(self.evidence.index[self._span[0]])
        rows = np.arange(begin, begin + count)
        if not self.run.another_robot:
            self._take_plant(states, window, rows)
            self._take_sensors(states, window, rows)
        self._take_answers(states, window)

    def _take_plant(self, states: States, window: _Window, rows: Integers) -> None:
        judged = self._follows(rows)
        computed = _computed(states.table, POSITION, VELOCITY, APPLIED)
        columns = self._columns(self.evidence.truth, window.truth, computed)
        self.plant.take(window.stamps, judged, columns)

    def _take_sensors(self, states: States, window: _Window, rows: Integers) -> None:
        if not len(self.evidence.measured):
            self.sensors.unjudged += len(rows)
            return
        seen = self._sensed(rows)
        judged = ~np.isnan(window.measured[:, 0]) & seen
        computed = _computed(states.table, SEEN_POSITION, SEEN_VELOCITY, SEEN_APPLIED)
        columns = self._columns(self.evidence.measured, window.measured, computed)
        self.sensors.take(window.stamps, judged, columns)

    def _follows(self, rows: Integers) -> Bools:
        """Return for which states of the span all that leads to them is on record."""
        begin, inputs, wire = self._span[0], self.inputs, self._wire
        before = rows - 1
        first = rows == begin
        before[first] = rows[first]
        known = inputs.disturbance_known[before]
        if wire is None:
            known = known & inputs.command_known[before]
        else:
            command = wire.used[self.evidence.index[before]]
            used = self._rows_at(command)
            there = (used >= begin) & inputs.command_known[np.maximum(used, 0)]
            known = known & (there | (command < 0))
        known[first] = self.evidence.index[rows[first]] == 0
        return known

    def _sensed(self, rows: Integers) -> Bools:
        """Return for which states of the span all that their measurement is made of is on record."""
        begin, inputs, wire = self._span[0], self.inputs, self._wire
        source = rows if wire is None else self._rows_at(wire.seen[self.evidence.index[rows]])
        inside = source >= begin
        delay_steps: int = self.simulator.config.delay_steps
        if self.evidence.index[begin] > 0:
            inside &= source - delay_steps >= begin
        known: Bools = inside & inputs.disturbance_known[np.maximum(source, 0)]
        return known

    def _rows_at(self, index: Integers) -> Integers:
        """Return the rows of states of the span, by their indices."""
        begin = self._span[0]
        return index - int(self.evidence.index[begin]) + begin

    def _columns(
        self, table: JointTable, recorded: Floats, computed: Floats
    ) -> list[ComparedColumn]:
        names = self.simulator.config.joints
        return [
            ComparedColumn(
                table.topic, f"{quantity}[{names[joint]}]", recorded[:, i], computed[:, i]
            )
            for i, (quantity, joint) in enumerate(_FIELDS)
        ]

    def _take_answers(self, states: States, window: _Window) -> None:
        table, commands = states.table, self._commands
        active = table[:, ACTIVE].astype(np.int64)
        given = window.commands >= 0
        efforts = np.full(len(active), np.nan)
        if given.any():
            efforts[given] = commands.values("effort", 1)[window.commands[given], 0]
        readable = ~np.isnan(window.measured[:, 0])
        effort = None
        if given.any():
            name = f"effort[{commands.names[0]}]"
            effort = ComparedColumn(commands.topic, name, efforts, table[:, EFFORT])
        for place, answers in enumerate(self.answers.values()):
            acts = (active >> place & 1) == 1
            mine, expected = active == 1 << place, acts
            if self._partial:
                expected = answers.answered(window.stamps)
                mine = expected & answers.is_own(window.commands)
            known = answers.is_known(window.stamps, readable, mine)
            # Of two that answered one state, the table has the effort of one and the terms of the other.
            judged = known & (active == 1 << place)
            terms = window.terms[place]
            answers.take(window.stamps, mine, given, judged, effort, terms, table)
            answers.unexpected(window.stamps, terms[0] & ~expected)
            if self._partial:
                self._note_turns(window.stamps, mine & known & ~acts, active)
        if not self._partial and self.answers:
            odd = given & (active & (active - 1) != 0)
            if not self.run.external:  # then that one gave it
                odd |= given & (active == 0)
            self._note_turns(window.stamps, odd, active)

    def _note_turns(self, stamps: Integers, odd: Bools, active: Integers) -> None:
        for row in np.flatnonzero(odd).tolist():
            count = float(int(active[row]).bit_count())
            self.unattributed.note(Difference(int(stamps[row]), "", ACTIVE_CONTROLLERS, count, 1.0))


def _computed(table: Floats, position: slice, velocity: slice, effort: int) -> Floats:
    zeros = np.zeros((len(table), 1))
    return np.hstack([table[:, position], table[:, velocity], zeros, table[:, effort, None]])


def _references(count: int, terms: Sequence[tuple[Bools, Floats]]) -> Floats:
    """Return the references on record [count], rad: those that came by topic are in no parameter."""
    values = np.full(count, np.nan)
    for there, record in terms:
        if record.shape[1]:
            values[there] = record[there, 0]
    return values
