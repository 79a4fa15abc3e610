"""What can be recomputed of a real-time run: each step from the torque that the record says acted.

Which command and which disturbance had arrived by a step is decided by the wall clock. The record
still shows it: the true state's effort is the torque over the previous step, and it has to be that of
some command that could have been in force; the measured state shows the disturbance that acted.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from math import inf

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Integers
from trunk_msgs_util.units import nanoseconds
from trunk_sim.disturbances import Disturbance
from trunk_sim.step import Plant, torque_of

from ..recorded.joint_table import JointTable
from ..recorded.run import RecordedRun
from ..recorded.turns import exact_from_ns
from ..recorded.wire import RecordedWire
from .bits import same
from .replay import Checked, Difference, acting_at, disturbances_matrix, judged


class PossibleDisturbances:
    """The disturbances that may have acted at a stamp, the newest first.

    One that has acted is never followed by an older one; none acts before the first, or after one that
    is older than the timeout. Where several messages are equal, the record does not show which of them
    was in force: the oldest is assumed, so that no later choice is ruled out.
    """

    def __init__(self, disturbances: JointTable, exact_ns: float = inf) -> None:
        """From ``exact_ns`` on, it is the one with the stamp."""
        self._exact_ns = exact_ns
        self._table = disturbances
        self._stamps = sorted(disturbances.rows)
        self._said = said = _said(disturbances, self._stamps)
        new = np.ones(len(said), bool)
        new[1:] = said[1:] != said[:-1]
        self._begins = np.flatnonzero(
            new
        )  # the rows whose message differs from that of the row before
        # By row: the first one of those before it that say the same.
        self._first: list[int] = np.maximum.accumulate(
            np.where(new, np.arange(len(said)), 0)
        ).tolist()
        self._alike: dict[int, list[int]] = {}  # content -> the rows from which on it is sent
        for row in self._begins.tolist():
            self._alike.setdefault(int(said[row]), []).append(row)
        self._since_ns = -1  # stamp of the oldest that may be in force

    def passed(self, first_ns: int, last_ns: int) -> None:
        """Note that from a stamp to another what each stamp's message says was in force.

        That may have been an older message that says the same, even if others came between the two.
        """
        row, stop = bisect_left(self._stamps, first_ns), bisect_right(self._stamps, last_ns)
        while row < stop:
            since = self._first[bisect_left(self._stamps, max(self._since_ns, self._stamps[0]))]
            alike = self._alike[int(self._said[row])]
            oldest = alike[bisect_left(alike, since)]
            self._since_ns = max(self._since_ns, self._stamps[oldest])
            later = self._begins[np.searchsorted(self._begins, row, side="right") :]
            row = int(later[0]) if len(later) else stop

    def at(self, stamp_ns: int, timeout_ns: int) -> Iterator[tuple[int, Disturbance]]:
        """Yield what may act at a stamp, one at least, each with its oldest message's stamp.

        Where nothing acts, the stamp is that of the message in force, -1 if there is none.
        """
        if stamp_ns >= self._exact_ns:
            yield stamp_ns, acting_at(self._table, stamp_ns)
            return
        oldest = bisect_left(self._stamps, max(self._since_ns, stamp_ns - timeout_ns))
        row = bisect_right(self._stamps, stamp_ns) - 1
        none = row < oldest
        while row >= oldest:
            first = max(self._first[row], oldest)
            yield self._stamps[first], acting_at(self._table, self._stamps[row])
            row = first - 1
        if none or self._since_ns < 0 or self._since_ns < stamp_ns - timeout_ns:
            yield self._since_ns, Disturbance()

    def chosen(self, since_ns: int) -> None:
        """Note the oldest message that may have acted."""
        self._since_ns = since_ns


def _said(disturbances: JointTable, stamps: Sequence[int]) -> Integers:
    """Return a number for what each message says, the same for the same bits, in the order of stamps."""
    if not all(disturbances.values(quantity).shape[1] == 2 for quantity in ("position", "effort")):
        return np.arange(len(stamps))  # they cannot be read as disturbances
    rows = [disturbances.rows[stamp] for stamp in stamps]
    bits = disturbances_matrix(disturbances, slice(None)).view(np.int64)[rows].reshape(-1, 4)
    return np.unique(bits, axis=0, return_inverse=True)[1].reshape(-1)


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
        if timeline.advance(now + 1):
            plant = timeline.config.plant
        before, torque = (truth.get(stamp, "effort")[1] for stamp in (now, after))
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
        for at in range(max(oldest, bisect_left(told, sent - timeout_ns)), newest):
            effort = commands.get(told[at], "effort", 1)[0]
            if same(acts(effort), torque):
                match = at if match < 0 else match
                possible.append(effort)
                if not wire.linked:
                    break
        timed_out = since_ns < 0 or sent - since_ns > timeout_ns
        if match < 0 and timed_out and torque == acts(0.0):
            possible = [0.0]
        if not possible:
            match, effort = newest - 1, 0.0
            if newest > 0:
                effort = commands.get(told[newest - 1], "effort", 1)[0]
            possible = [effort]
            yield Checked(after, [_not_in_force(after, truth.topic, torque, acts(effort))])
        else:
            yield Checked(after, ())
        if match >= 0 and sent >= last:
            first, since_ns, last = match, told[match], sent
        if wire.linked:
            known[sent] = possible


def _not_in_force(stamp_ns: int, topic: str, torque: float, computed: float) -> Difference:
    return Difference(stamp_ns, topic, "effort[in force]", torque, computed)
