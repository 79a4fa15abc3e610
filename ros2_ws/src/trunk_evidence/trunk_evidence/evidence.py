"""What counts of a run: which states, what acted on the plant in each, and which controller acted when.

In real time the simulator records the command and the disturbance in force. In simulated time they follow:
each state's own. `Rerun` judges these numbers.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Bools, Floats, Integers
from trunk_core.parameters.declarations import ParameterError
from trunk_core.topics import Event
from trunk_core.units import held, nanoseconds, seconds
from trunk_msgs_util.source import NO_SOURCE, sources_of_inputs
from trunk_recording.joint_table import QUANTITIES, JointTable
from trunk_recording.reader import RecordingError
from trunk_runs.timeline import Operated, begins_active
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Signals, pulse
from trunk_sim.inputs import Applied
from trunk_sim.links import Traffic

from .senders import Process

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from trunk_recording.joint_table import JointTable
    from trunk_runs.timeline import Timeline

    from .recorded_run import RecordedRun


class InForce(NamedTuple):
    """The inputs of n states; a stamp of -1: nothing is in force."""

    command: Floats  # [n] over the step from the state, N m; NaN: not on record
    command_ns: Integers  # [n], the state that it answers
    command_source: Integers  # [n], index into `RecordedInputs.sources`
    disturbance: Floats  # [n, 4], in the order of the channels; zeros where it is not on record
    disturbance_ns: Integers  # [n]
    disturbance_source: Integers  # [n]


class RecordedInputs:
    """A run's inputs. ``command_known`` [N], ``disturbance_known`` [N]: what is on record of each state's."""

    def __init__(self, run: RecordedRun, stamps: Integers) -> None:
        """``stamps``: of the states, ns, ascending. Raises RecordingError for other messages."""
        self.sources: tuple[str, ...] = (NO_SOURCE,)
        self.recorded = run.real_time or run.another_robot or run.count(topics.PLANT_INPUTS) > 0
        self._stamps = stamps
        self._commands = run.table(topics.EFFORT_COMMAND)
        self._disturbances = run.table(topics.DISTURBANCE)
        self._table = run.table(topics.PLANT_INPUTS) if self.recorded else None
        self._rows: Integers | None = None  # of the simulator whose run it is; None: all
        if self._table is not None:
            self._read_sources(run, self._table)
            simulator = run.process("simulator")
            if simulator is not None and not simulator.sent_all(self._table):
                self._rows = simulator.rows(self._table)
            self.command_known: Bools = self._table.rows_of(stamps, self._rows) >= 0
            self.disturbance_known: Bools = self.command_known
            return
        self.sources = ("",)
        answered = self._commands.rows_of(stamps) >= 0
        self.command_known = answered | np.isin(stamps, idle_ns(run))
        self.disturbance_known = np.ones(len(stamps), bool)
        if len(self._disturbances) and not np.array_equal(
            self._disturbances.stamp_ns[: len(stamps)], stamps
        ):
            since_ns = int(self._disturbances.stamp_ns.min())
            if "disturbance" in run.config("simulator").wait_for:
                since_ns = 0
            there = self._disturbances.rows_of(stamps) >= 0
            self.disturbance_known = there | (stamps < since_ns)

    def _read_sources(self, run: RecordedRun, table: JointTable) -> None:
        if not len(table):
            return
        parts = [sources_of_inputs(frame) for frame in table.frames]
        widths = [table.width(quantity) for quantity in QUANTITIES]
        if table.names != topics.INPUT_NAMES or widths != [5, 5, 0] or None in parts:
            raise RecordingError(
                f"{run.path}: {topics.PLANT_INPUTS}: not as a simulator writes it: it cannot be recomputed"
            )
        names = dict.fromkeys(
            [NO_SOURCE, *(name or NO_SOURCE for part in parts for name in part or ())]
        )
        self.sources = tuple(names)
        places = {name: place for place, name in enumerate(names)}
        self._of_frame = np.array(
            [[places[name or NO_SOURCE] for name in part or ()] for part in parts]
        )

    def over(self, rows: slice) -> InForce:
        """Return the inputs of some of the states."""
        stamps = self._stamps[rows]
        if self._table is None:
            return self._by_stamp(stamps)
        if not len(self._table):
            return _nothing_known(len(stamps))
        at = self._table.rows_of(stamps, self._rows)
        there = at >= 0
        position, age = (self._table.values(q)[at] for q in ("position", "velocity"))
        source = self._of_frame[self._table.frame[at]]
        command_ns, disturbance_ns = (
            np.where(there & (age[:, i] >= 0.0), stamps - _whole(age[:, i]), -1) for i in (0, 1)
        )
        return InForce(
            np.where(there, position[:, 0], np.nan),
            command_ns,
            source[:, 1],
            np.where(there[:, None], position[:, 1:], 0.0),
            disturbance_ns,
            source[:, 2],
        )

    def ages(self, rows: slice, force: InForce) -> tuple[Floats, Floats]:
        """Return the inputs' ages on record [n, 5], ns, and as a simulator writes them for ``force``."""
        stamps = self._stamps[rows]
        ages = np.column_stack(
            [
                np.where(ns >= 0, stamps - ns, -1)
                for ns in (force.command_ns, *[force.disturbance_ns] * 4)
            ]
        ).astype(np.float64)
        if self._table is None or not len(self._table):
            return ages, ages
        return self._table.values("velocity")[self._table.rows_of(stamps, self._rows)], ages

    def _by_stamp(self, stamps: Integers) -> InForce:
        force = _nothing_known(len(stamps))
        command, command_ns, _, disturbance, disturbance_ns, _ = force
        if len(self._commands):
            rows = self._commands.rows_of(stamps)
            there = rows >= 0
            command[there] = self._commands.values("effort", 1)[rows[there], 0]
            command_ns[there] = stamps[there]
        if len(self._disturbances):
            rows = self._disturbances.rows_of(stamps)
            there = rows >= 0
            disturbance[there] = disturbances(self._disturbances, rows[there])
            disturbance_ns[there] = stamps[there]
        return force


def _nothing_known(count: int) -> InForce:
    none = np.zeros(count, np.int64)
    return InForce(
        np.full(count, np.nan), none - 1, none, np.zeros((count, 4)), none - 1, none.copy()
    )


def most_steps(states: int) -> int:
    """Return how many steps a run has at most of which so many states are on record."""
    return 10 * states + 100_000


def delivered_ns(config: SimulatorConfig, stamps: Integers) -> Integers:
    """Return which state's command the link delivers in each of these states, by stamp; -1: none."""
    if config.network is None or not len(stamps):
        return stamps
    wanted = int(stamps.max()) // config.period_ns + 1
    steps = max(min(wanted, most_steps(len(stamps))), 1)
    used = Traffic(config.network).command_steps(steps)[
        np.clip(stamps // config.period_ns, 0, steps - 1)
    ]
    return np.where(used >= 0, used * config.period_ns, -1)


def disturbances(table: JointTable, rows: slice | Integers) -> Floats:
    """Return some recorded disturbances [N, 4], in the order of the channels.

    Raises RecordingError if they are not those of two joints.
    """
    effort, position = (table.values(quantity, 2) for quantity in ("effort", "position"))
    return np.hstack([effort[rows], position[rows]])


def _whole(age: Floats) -> Integers:
    """Return ages as whole ns, within bounds."""
    return np.nan_to_num(np.clip(age, -1.0, 2.0**62)).astype(np.int64)


def operated_of(run: RecordedRun) -> Operated:
    """Return an operator's pushes and limits. Raises RecordingError for messages that cannot be read so.

    A simulator without limits publishes none, and no other node's act.
    """
    if not (run.count(topics.OPERATOR_PUSH) and "simulator" in run.parameters):
        return Operated((), None)
    try:
        limits = run.config("simulator").operator_limits
    except ParameterError as error:
        raise RecordingError(f"{run.path}: {error}") from None
    if limits is None:
        return Operated((), None)
    table = run.table(topics.OPERATOR_PUSH)
    simulator = run.process("simulator")
    rows = simulator.rows(table) if simulator else np.arange(len(table))
    stamps = table.stamp_ns[rows]
    odd = table.width("effort") != 2 or not np.isfinite(table.values("effort")[rows]).all()
    if odd or (np.diff(stamps) <= 0).any():
        raise RecordingError(f"{run.path}: {table.topic}: not as a simulator writes it")
    values = (limits.clip(Applied(*row)) for row in table.values("effort")[rows].tolist())
    return Operated(tuple(zip(stamps.tolist(), values, strict=True)), limits)


class Pulse(NamedTuple):
    """A span of time in which a pulse acts: ``start <= t < end`` in s, magnitude in the channel's unit."""

    start: float
    end: float
    channel: str
    magnitude: float


def pulses_of(run: RecordedRun, in_force: bool = True) -> list[Pulse]:
    """Return the spans in which a pulse acted, or by its messages was to act if not ``in_force``.

    A table whose values are held makes pulses too: each value that is not zero is one.
    Raises RecordingError for messages that cannot be read so, ParameterError for parameters.
    """
    stamps = acting = run.series({topics.DISTURBANCE: ()}).popitem()[1].stamp_ns
    if in_force and run.count(topics.PLANT_INPUTS):
        stamps, acting = _in_force(run)
    return sorted(p for at in (_pulse_at, _held_at) for p in _windows(run, stamps, acting, at))


def idle_pulses(run: RecordedRun) -> list[Pulse]:
    """Return the pulses of a real-time run of which no message was in force; raises as `pulses_of`."""
    stamps, acting = _in_force(run)
    last_ns = stamps.max(initial=-1)
    spans = [(nanoseconds(p.start), nanoseconds(p.end), p) for p in pulses_of(run, in_force=False)]
    return [
        pulse
        for start, end, pulse in spans
        if start <= last_ns and not ((start <= acting) & (acting < end)).any()
    ]


def _in_force(run: RecordedRun) -> tuple[Integers, Integers]:
    """Return the stamps of the states, and those of the disturbances in force in them, ns."""
    stamps = np.unique(run.table(topics.GROUND_TRUTH).stamp_ns)
    return stamps, RecordedInputs(run, stamps).over(slice(None)).disturbance_ns


def _pulse_at(stamp_ns: int, s: Signals) -> tuple[int, float]:
    return s.pulse_channel, pulse(stamp_ns, s.pulse_starts, s.pulse_duration, s.pulse_magnitude)


def _held_at(stamp_ns: int, s: Signals) -> tuple[int, float]:
    if s.table_linear or not s.table_times:
        return s.table_channel, 0.0
    return s.table_channel, held(stamp_ns, s.table_times, s.table_values, 0.0)


def _windows(
    run: RecordedRun,
    stamps: Integers,
    acting: Integers,
    at: Callable[[int, Signals], tuple[int, float]],
) -> Iterator[Pulse]:
    """Yield the windows of stamps in which a signal, which is constant in pieces, is not zero.

    ``acting``: the stamp of the message that acts at each stamp, ns; -1: none.
    """
    timeline = run.timeline("disturbance")
    signals, channels = timeline.config.signals, timeline.config.kind.channels
    open_since: tuple[int, int, float] | None = None
    part = np.searchsorted(sorted({0, *_edges(run.timeline("disturbance"))}), acting, "right")
    rows = np.flatnonzero(np.diff(part, prepend=-1))
    for stamp_ns, message_ns in zip(stamps[rows].tolist(), acting[rows].tolist(), strict=True):
        if timeline.advance(message_ns):
            signals = timeline.config.signals
        channel, value = at(message_ns, signals) if message_ns >= 0 else (-1, 0.0)
        if open_since is not None and (channel, value) != open_since[1:]:
            start, before, magnitude = open_since
            yield Pulse(seconds(start), seconds(stamp_ns), channels[before], magnitude)
            open_since = None
        if value != 0.0 and open_since is None:
            open_since = stamp_ns, channel, value
    if open_since is not None:
        start, before, magnitude = open_since
        yield Pulse(seconds(start), seconds(int(stamps[-1])), channels[before], magnitude)


def _edges(timeline: Timeline) -> set[int]:
    """Return the times, ns, at which pulses and held values may change; they are constant in between."""
    edges: set[int] = set()
    for change_ns in (-1, *(change.stamp_ns for change in timeline.to_come)):
        timeline.advance(change_ns + 1)
        signals = timeline.config.signals
        ends = (start + signals.pulse_duration for start in signals.pulse_starts)
        edges |= {change_ns + 1, *signals.pulse_starts, *ends, *signals.table_times}
    return edges


class Turn(NamedTuple):
    """A controller acts from its first update at ``start``, in s, until the next turn begins."""

    start: float
    controller: str


def acting(stamps: Integers, turns: Iterable[tuple[int, bool]], begins: bool) -> Bools:
    """Return for each stamp, ns, whether a controller acts there, by its turns in their order.

    A turn is a stamp, ns, and True if it makes the controller active; it takes effect after its stamp.
    ``begins``: the controller acts from the start, although no turn says so.
    """
    mask = np.zeros(len(stamps), bool)
    since: int | None = -1 if begins else None
    for stamp_ns, active in turns:
        if active:
            since = stamp_ns
        elif since is not None:
            mask |= (stamps > since) & (stamps <= stamp_ns)
            since = None
    return mask if since is None else mask | (stamps > since)


def acts(run: RecordedRun, controller: str, stamps: Integers) -> Bools:
    """Return for each stamp, ns, whether a controller is active there, by its events and parameters.

    Raises RecordingError and ParameterError as `RecordedRun.changes` and `config` do.
    """
    changes = run.changes(controller)
    turns = [
        (change.stamp_ns, change.event == Event.ACTIVATED)
        for change in sorted(changes, key=lambda change: change.stamp_ns)
        if change.values is None and change.event != Event.RESET
    ]
    return acting(stamps, turns, begins_active(run.config(controller), changes))


def idle_ns(run: RecordedRun) -> Integers:
    """Return the stamps, ns, of the states of an offline run that no controller was to answer.

    That is between two controllers that were switched by hand. In a graph this is not known: in
    lock-step the plant waits for an answer, and in real time an answer may be late. Raises RecordingError
    and ParameterError as `RecordedRun.changes` and `config` do.
    """
    stamps = run.table(topics.GROUND_TRUTH).stamp_ns
    if run.mode != "offline" or run.another_controller:
        return stamps[:0]
    anybody = np.zeros(len(stamps), bool)
    for name in run.controllers:
        anybody |= acts(run, name, stamps)
    idle: Integers = stamps[~anybody]
    return idle


def recorded_turns(run: RecordedRun) -> tuple[Turn, ...]:
    """Return the turns in order: one for a single controller, none without a controller.

    An external controller acts from the start until one of the project's updates.
    """
    names = run.judgeable if run.external else run.controllers
    states = run.series({topics.controller_state(name): () for name in names})
    stamps = [state.stamp_ns for state in states.values()]
    before = (Turn(0.0, run.external),) if run.external else ()
    if not stamps or not any(map(len, stamps)):
        return before
    who = np.repeat(np.arange(len(names)), [len(s) for s in stamps])
    when = np.concatenate(stamps)
    order = np.argsort(when, kind="stable")
    who, when = who[order], when[order]
    first = np.flatnonzero(np.diff(who, prepend=-1))
    ours = tuple(
        Turn(seconds(stamp_ns - run.begin_ns), names[index])
        for stamp_ns, index in zip(when[first].tolist(), who[first].tolist(), strict=True)
    )
    return ours if ours[0].start <= 0.0 else before + ours


_MOST_GAPS = 1000


class Evidence:
    """The states of one run of the plant: on the grid, ascending, without an impossible gap.

    ``stamps`` [N]: ns. ``index`` [N]: steps of the plant. ``spans``: rows [begin, end) without a gap.
    ``cut_ns``: stamp of the first state that cannot be placed, if there is one.
    """

    def __init__(self, run: RecordedRun) -> None:
        """Raise RecordingError and ParameterError for messages and parameters that cannot be used."""
        simulator = run.process("simulator")
        if simulator is None:
            raise RecordingError(f"{run.path}: no simulator is on record: record the run with it")
        self.run, self.simulator = run, simulator
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
        controllers = [run.config(name) for name in run.judgeable]
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
