"""What can be recomputed of a real-time run: each step from the torque that the record says acted.

Which command and which disturbance had arrived by a step is decided by the wall clock. The record
still shows it: the true state's effort is the torque over the previous step, and it has to be that of
some command that could have been in force; the measured state shows the disturbance that acted.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterator, Sequence
from math import inf

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.units import nanoseconds
from trunk_sim.disturbances import Disturbance
from trunk_sim.step import Plant, torque_of

from ..recorded.joint_table import JointTable
from ..recorded.run import RecordedRun
from ..recorded.turns import exact_from_ns
from ..recorded.wire import RecordedWire
from .bits import same
from .replay import Checked, Difference, acting_at, disturbances_matrix, judged

_HIDDEN = 1e-6  # relative, and in N, N m, m and rad: well above what rounding hides in a state


class PossibleDisturbances:
    """The disturbances that may have acted at a stamp, the newest first.

    One that has acted is never followed by an older one; none acts before the first, or after one that
    is older than the timeout. Where the record does not show which of them was in force, the oldest is
    assumed, so that no later choice is ruled out.
    """

    def __init__(self, disturbances: JointTable, exact_ns: float = inf) -> None:
        """From ``exact_ns`` on, it is the one with the stamp."""
        self._exact_ns = exact_ns
        self._table = disturbances
        self._stamps = sorted(disturbances.rows)
        self._values = values = _values(disturbances, self._stamps)
        new = np.ones(len(values), bool)
        new[1:] = np.any(values[1:].view(np.int64) != values[:-1].view(np.int64), axis=1)
        # The rows whose message differs from that of the row before.
        self._begins: list[int] = np.flatnonzero(new).tolist()
        # By row: the first one of those before it that say the same.
        self._first: list[int] = np.maximum.accumulate(
            np.where(new, np.arange(len(values)), 0)
        ).tolist()
        self._since_ns = -1  # stamp of the oldest that may be in force

    def passed(
        self, first_ns: int, last_ns: int, timeout_ns: int, no_effect: Collection[int] = ()
    ) -> None:
        """Note that from a stamp to another everything was as if each stamp's message had acted.

        An older message that says nearly the same may have acted: rounding hides small differences. Where a
        message says that nothing acts, the one in force may also have been too old.
        ``no_effect``: the channels, by number, that change neither the plant nor what is measured.
        """
        seen = [channel for channel in range(4) if channel not in no_effect]
        row, stop = bisect_left(self._stamps, first_ns), bisect_right(self._stamps, last_ns)
        if row == stop:
            return
        # What is compared, from the oldest message that may be in force on.
        lowest = bisect_right(self._begins, self._oldest(self._stamps[row], timeout_ns)) - 1
        lowest = max(lowest, 0)
        highest = bisect_left(self._begins, stop)
        said = self._values[self._begins[lowest:highest]][:, seen].tolist()
        quiet = [0.0] * len(seen)
        at = bisect_right(self._begins, row) - 1
        while row < stop:
            stamp_ns, own = self._stamps[row], said[at - lowest]
            if not (self._nothing_acts(stamp_ns, timeout_ns) and _nearly_equal(own, quiet)):
                oldest = self._oldest(stamp_ns, timeout_ns)
                possible = bisect_right(self._begins, oldest) - 1
                while possible < at and not _nearly_equal(said[possible - lowest], own):
                    possible += 1
                self._since_ns = self._stamps[max(self._begins[possible], oldest)]
            at += 1
            row = self._begins[at] if at < len(self._begins) else stop

    def _oldest(self, stamp_ns: int, timeout_ns: int) -> int:
        """Return the row of the oldest message that may be in force and is not too old."""
        return bisect_left(self._stamps, max(self._since_ns, stamp_ns - timeout_ns))

    def _nothing_acts(self, stamp_ns: int, timeout_ns: int) -> bool:
        """Return True if perhaps no message has come, or the one in force is too old."""
        return self._since_ns < 0 or self._since_ns < stamp_ns - timeout_ns

    def at(self, stamp_ns: int, timeout_ns: int) -> Iterator[tuple[int, Disturbance]]:
        """Yield what may act at a stamp, one at least, each with its oldest message's stamp.

        Where nothing acts, the stamp is that of the message in force, -1 if there is none.
        """
        if stamp_ns >= self._exact_ns:
            yield stamp_ns, acting_at(self._table, stamp_ns)
            return
        oldest = self._oldest(stamp_ns, timeout_ns)
        row = bisect_right(self._stamps, stamp_ns) - 1
        none = row < oldest
        while row >= oldest:
            first = max(self._first[row], oldest)
            yield self._stamps[first], acting_at(self._table, self._stamps[row])
            row = first - 1
        if none or self._nothing_acts(stamp_ns, timeout_ns):
            yield self._since_ns, Disturbance()

    def chosen(self, since_ns: int) -> None:
        """Note the oldest message that may have acted."""
        self._since_ns = since_ns


def _values(disturbances: JointTable, stamps: Sequence[int]) -> Floats:
    """Return what each message says [N, 4], in the order of stamps and channels."""
    if not all(disturbances.values(quantity).shape[1] == 2 for quantity in ("position", "effort")):
        # They cannot be read as disturbances: each one differs from the others.
        return np.repeat(np.arange(len(stamps), dtype=float).reshape(-1, 1), 4, axis=1)
    rows = [disturbances.rows[stamp] for stamp in stamps]
    return disturbances_matrix(disturbances, slice(None))[rows].reshape(-1, 4)


def _nearly_equal(a: Sequence[float], b: Sequence[float]) -> bool:
    """Return True if rounding may hide the difference."""
    return all(abs(x - y) <= _HIDDEN * max(1.0, abs(x), abs(y)) for x, y in zip(a, b, strict=True))


def replay_torques(run: RecordedRun, until_ns: int | None = None) -> Iterator[Checked]:
    """Yield, for each step, whether its torque is that of a command that could be in force.

    That is the command for this state or an earlier one, never older than one that was in force before;
    0 before the first, and where the newest is older than ``command_timeout``. In the
    simulated part of a branch, it is the command for this state, or the one before it if there is none.
    Where a link carries the commands, "this state" is the one whose command is in use.
    """
    truth, commands = run.table(topics.GROUND_TRUTH), run.table(topics.EFFORT_COMMAND)
    timeline = run.timeline("simulator")
    stamps = judged(truth.stamp_ns, until_ns).tolist()
    told = sorted(commands.rows)
    first = 0  # the oldest command that may be in force
    since_ns = -1
    exact_ns = exact_from_ns(run)
    plant = timeline.config.plant
    wire = RecordedWire(timeline.config, truth.stamp_ns)
    known: dict[int, list[float]] = {}  # what may have been sent, by the stamps of the steps
    last = -1  # the latest of these
    for row in range(1, len(stamps)):
        now, after = stamps[row - 1], stamps[row]
        resets = _Resets()
        if timeline.advance(now + 1, resets):
            plant = timeline.config.plant
        before, torque = (truth.get(stamp, "effort")[1] for stamp in (now, after))
        if resets.count:
            before = 0.0  # the drive's as well
        timeout_ns = nanoseconds(timeline.config.command_timeout)
        sent = wire.told_ns(now)

        def acts(effort: float, before: float = before, plant: Plant = plant) -> float:
            return torque_of(before, effort, plant)

        if sent < 0 or sent in known:
            possible = known.get(sent, [0.0])
            fitting = [effort for effort in possible if same(acts(effort), torque)]
            if fitting:
                known[sent] = fitting
                yield Checked(after, ())
            else:
                yield Checked(after, [_not_in_force(after, truth.topic, torque, acts(possible[0]))])
            continue
        newest = bisect_right(told, sent)
        if sent >= exact_ns:
            first = max(first, newest - 1)
        oldest = first if sent >= last else 0  # a link may bring back what was sent before
        match, possible = -1, []
        # If the latest one may be too old, none acts: a later command of 0 would rule out those before it.
        stale = since_ns < 0 or sent < last or sent - since_ns > timeout_ns
        if stale and torque == acts(0.0):
            possible.append(0.0)
        timed_out = bool(possible)
        if not timed_out or wire.linked:
            for at in range(max(oldest, bisect_left(told, sent - timeout_ns)), newest):
                effort = commands.get(told[at], "effort", 1)[0]
                if same(acts(effort), torque):
                    match = at if match < 0 else match
                    possible.append(effort)
                    if not wire.linked:
                        break
        if not possible:
            match, effort = newest - 1, 0.0
            if newest > 0:
                effort = commands.get(told[newest - 1], "effort", 1)[0]
            possible = [effort]
            yield Checked(after, [_not_in_force(after, truth.topic, torque, acts(effort))])
        else:
            yield Checked(after, ())
        if match >= 0 and not timed_out and sent >= last:
            first, since_ns, last = match, told[match], sent
        if wire.linked:
            known[sent] = possible


class _Resets:
    """Counts a simulator's resets."""

    count = 0

    def retune(self, config: object) -> None:
        """Ignore other parameters."""

    def reset(self) -> None:
        """Count one."""
        self.count += 1


def _not_in_force(stamp_ns: int, topic: str, torque: float, computed: float) -> Difference:
    return Difference(stamp_ns, topic, "effort[in force]", torque, computed)
