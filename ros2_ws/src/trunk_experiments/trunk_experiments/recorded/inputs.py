"""What acted on the plant in each state of a run: the command and the disturbance in force.

In real time the simulator records it. In simulated time it follows: each state's own command and disturbance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.recording.joint_table import QUANTITIES, Bools, Floats, Integers
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.source import NO_SOURCE, sources_of_inputs
from trunk_msgs_util.units import held, nanoseconds, seconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import CHANNELS, Signals, pulse
from trunk_sim.links import Traffic
from trunk_sim.operator_input import Applied

from ..plans.pushes import Operated
from .processes import simulator_of
from .turns import idle_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from trunk_msgs_util.recording.joint_table import JointTable

    from ..plans.timeline import Timeline
    from .run import RecordedRun


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
            if len(run.processes("simulator")) > 1:
                self._rows = simulator_of(run).rows(self._table)
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
    rows = simulator_of(run).rows(table)
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
    signals = timeline.config.signals
    open_since: tuple[int, int, float] | None = None
    part = np.searchsorted(sorted({0, *_edges(run.timeline("disturbance"))}), acting, "right")
    rows = np.flatnonzero(np.diff(part, prepend=-1))
    for stamp_ns, message_ns in zip(stamps[rows].tolist(), acting[rows].tolist(), strict=True):
        if timeline.advance(message_ns):
            signals = timeline.config.signals
        channel, value = at(message_ns, signals) if message_ns >= 0 else (-1, 0.0)
        if open_since is not None and (channel, value) != open_since[1:]:
            start, before, magnitude = open_since
            yield Pulse(seconds(start), seconds(stamp_ns), CHANNELS[before], magnitude)
            open_since = None
        if value != 0.0 and open_since is None:
            open_since = stamp_ns, channel, value
    if open_since is not None:
        start, before, magnitude = open_since
        yield Pulse(seconds(start), seconds(int(stamps[-1])), CHANNELS[before], magnitude)


def _edges(timeline: Timeline) -> set[int]:
    """Return the times, ns, at which pulses and held values may change; they are constant in between."""
    edges: set[int] = set()
    for change_ns in (-1, *(change.stamp_ns for change in timeline.to_come)):
        timeline.advance(change_ns + 1)
        signals = timeline.config.signals
        ends = (start + signals.pulse_duration for start in signals.pulse_starts)
        edges |= {change_ns + 1, *signals.pulse_starts, *ends, *signals.table_times}
    return edges
