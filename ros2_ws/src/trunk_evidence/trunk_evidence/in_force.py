"""Whether what acted on the plant is on record: disturbances by their signals, inputs by their messages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Bools, Floats, Integers
from trunk_core.compiled import twin, with_arrays
from trunk_core.units import nanoseconds
from trunk_msgs_util.source import ARRIVAL, NO_SOURCE
from trunk_recording.joint_table import JointTable
from trunk_runs.timeline import Timeline
from trunk_sim.disturbances import Signals, disturbance_at

from .evidence import InForce, disturbances
from .recorded_run import RecordedRun
from .rerun import Rerun
from .senders import Process
from .verdict import MISSING, Check, ComparedColumn

_WORTH_COMPILING = (
    20_000  # messages: for fewer, loading compiled code takes longer than computing them
)
_ROWS = 50_000  # at a time
_CHANNELS = ("effort[{0}]", "effort[{1}]", "position[{0}]", "position[{1}]")


def signals_over(stamps: Sequence[int] | Integers, signals: Signals, out: Floats) -> None:
    """Write what the signals say at these stamps, ns [n], into ``out`` [n, 4]. Compiles unchanged."""
    for row in range(len(stamps)):
        acting = disturbance_at(stamps[row], signals)
        out[row, 0], out[row, 1] = acting.hip_force, acting.trunk_torque
        out[row, 2], out[row, 3] = acting.hip_offset, acting.trunk_offset


def check_disturbances(run: RecordedRun, process: Process) -> Check:
    """Compare a disturbance node's messages with its signals. Raises as its `Process` does."""
    check = Check("disturbances")
    table = run.table(topics.DISTURBANCE)
    rows = process.rows(table)
    stamps = table.stamp_ns[rows]
    timeline = Timeline(process.config, process.changes)
    quick = len(stamps) >= _WORTH_COMPILING
    names = [field.format(*table.names) for field in _CHANNELS] if len(rows) else []
    for begin, end in _stretches(stamps, timeline):
        signals = timeline.config.signals
        out = np.empty((end - begin, 4))
        if quick:
            twin(signals_over)(stamps[begin:end], with_arrays(signals), out)
        else:
            signals_over(stamps[begin:end].tolist(), signals, out)
        recorded = disturbances(table, rows[begin:end])
        columns = [
            ComparedColumn(table.topic, name, recorded[:, i], out[:, i])
            for i, name in enumerate(names)
        ]
        check.take(stamps[begin:end], np.ones(end - begin, bool), columns)
    return check


def _stretches(stamps: Integers, timeline: Timeline) -> Iterator[tuple[int, int]]:
    """Yield consecutive messages between changes of parameters, which are made before them."""
    begin = 0
    while begin < len(stamps):
        timeline.advance(int(stamps[begin]))
        later = np.flatnonzero(stamps[begin : begin + _ROWS] > timeline.next_ns)
        end = begin + int(later[0]) if len(later) else min(begin + _ROWS, len(stamps))
        yield begin, max(end, begin + 1)
        begin = max(end, begin + 1)


def check_inputs(run: RecordedRun, rerun: Rerun) -> Check:
    """Compare the recorded inputs with the messages that they name, and with the rule that chose them."""
    check = Check("inputs of the plant")
    stamps, inputs = rerun.stamps, rerun.inputs
    commands, disturbed = run.table(topics.EFFORT_COMMAND), run.table(topics.DISTURBANCE)
    rule = _Rule(rerun.simulator, _is_awaited(disturbed, rerun.simulator))
    for begin in range(0, len(stamps), _ROWS):
        rows = slice(begin, min(begin + _ROWS, len(stamps)))
        force, here = inputs.over(rows), stamps[rows]
        values = force.command[:, None]
        topic = commands.topic
        command_columns, commanded = _named(
            topic,
            ["effort"],
            commands,
            force.command_ns,
            force.command_source,
            values,
            rerun,
        )
        disturbance_columns, known = _named(
            disturbed.topic,
            [field.format(*rerun.simulator.config.joints) for field in _CHANNELS],
            disturbed,
            force.disturbance_ns,
            force.disturbance_source,
            force.disturbance,
            rerun,
        )
        ages = (
            ComparedColumn(topics.PLANT_INPUTS, f"velocity[{name}]", recorded, written)
            for name, recorded, written in zip(
                topics.INPUT_NAMES, *(part.T for part in inputs.ages(rows, force)), strict=True
            )
        )
        columns = [*command_columns, *disturbance_columns, *ages, *rule.columns(here, force)]
        check.take(here, inputs.command_known[rows] & commanded & known, columns)
    return check


def _named(
    topic: str,
    fields: list[str],
    table: JointTable,
    stamp_ns: Integers,
    source: Integers,
    values: Floats,
    rerun: Rerun,
) -> tuple[list[ComparedColumn], Bools]:
    """Return the values in force beside those of the messages with their sources and stamps; which are known.

    What no node of ours sent, and is not on record, is not known. One that acts from its arrival is known by
    its torque alone.
    """
    expected = values.copy()
    expected[stamp_ns < 0] = 0.0
    missing = np.zeros(len(values))
    on_record = np.ones(len(values), bool)
    for place in np.unique(source).tolist():
        name = rerun.inputs.sources[place]
        if name == ARRIVAL:
            mine = np.flatnonzero((source == place) & (stamp_ns >= 0))
            on_record[mine] = np.isin(values[mine, 0], _values(table, _rows_of(table, NO_SOURCE)))
            continue
        mine = np.flatnonzero((source == place) & (stamp_ns >= 0))
        rows = _rows_of(table, name)
        sent = table.stamp_ns[rows]
        order = np.argsort(sent, kind="stable")
        at = np.searchsorted(sent[order], stamp_ns[mine])
        at = np.minimum(at, max(len(sent) - 1, 0))
        there = sent[order][at] == stamp_ns[mine] if len(sent) else np.zeros(len(mine), bool)
        if there.any():
            expected[mine[there]] = _values(table, rows[order][at[there]])
        if name == NO_SOURCE:
            on_record[mine[~there]] = False
        else:
            missing[mine[~there]] = 1.0
    columns = [
        ComparedColumn(topic, f"{field} in force", values[:, i], expected[:, i])
        for i, field in enumerate(fields)
    ]
    return [*columns, ComparedColumn(topic, MISSING, missing, np.zeros(len(missing)))], on_record


def _rows_of(table: JointTable, source: str) -> Integers:
    if source == NO_SOURCE:
        strangers = [place for place, name in enumerate(table.frames) if "@" not in name]
        return np.flatnonzero(np.isin(table.frame, strangers))
    if source not in table.frames:
        return np.zeros(0, np.int64)
    return np.flatnonzero(table.frame == table.frames.index(source))


def _values(table: JointTable, rows: Integers) -> Floats:
    if table.topic == topics.DISTURBANCE:
        return disturbances(table, rows)
    return table.values("effort")[rows, -1:]


def _is_awaited(disturbed: JointTable, simulator: Process) -> bool:
    """Return True if the first state waited for a disturbance of ours, which then is in force in it."""
    ours = all("@" in frame for frame in disturbed.frames)
    return ours and 0 in disturbed and topics.DISTURBANCE in simulator.config.wait_for


class _Rule:
    """The simulator's rule: what is in force is the newest that has come, and nothing too old."""

    def __init__(self, simulator: Process, awaited: bool) -> None:
        self._awaited = awaited
        timeline = Timeline(simulator.config, simulator.changes)
        self._since = [-1]
        self._timeouts = [nanoseconds(simulator.config.command_timeout)]
        for change in simulator.changes:
            if timeline.advance(change.stamp_ns + 1):
                self._since.append(change.stamp_ns)
                self._timeouts.append(nanoseconds(timeline.config.command_timeout))
        self._newest = {"command": -1, "disturbance": -1}

    def columns(self, stamps: Integers, force: InForce) -> Iterator[ComparedColumn]:
        """Yield 1 where a message in force is older than one before it, too old, or dropped too early."""
        at = np.searchsorted(self._since, stamps, "right") - 1
        # A change is taken in between two steps: either timeout may have been in force.
        timeouts = np.array(self._timeouts)
        longest = np.maximum(timeouts[at], timeouts[np.maximum(at - 1, 0)])
        shortest = np.minimum(timeouts[at], timeouts[np.maximum(at - 1, 0)])
        for kind, stamp_ns in (
            ("command", force.command_ns),
            ("disturbance", force.disturbance_ns),
        ):
            newest = np.maximum.accumulate(np.append(self._newest[kind], stamp_ns))
            self._newest[kind] = int(newest[-1])
            before, acts = newest[:-1], stamp_ns >= 0
            wrong = acts & ((stamp_ns < before) | (stamps - stamp_ns > longest))
            wrong |= acts & (stamp_ns > stamps)
            wrong |= ~acts & (before >= 0) & (stamps - before <= shortest)
            if self._awaited and kind == "disturbance":
                wrong |= ~acts & (stamps == 0)
            yield ComparedColumn(
                topics.PLANT_INPUTS, f"{kind} in force", wrong.astype(float), np.zeros(len(wrong))
            )
