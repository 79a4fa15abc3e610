"""A recorded run's controllers and disturbances recomputed: each command from the recorded states.

The record drives the same pure functions that the nodes compose; a parameter change or a reset takes
effect where the record says that it did. Compiled code (`stretches`) skips long stretches in which
everything agrees; elsewhere, this module checks step by step.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trunk_control.decide import state_record
from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.with_arrays import with_arrays
from trunk_sim.disturbances import Disturbance, disturbance_at, disturbance_sample

from ..recorded.joint_table import JointTable
from ..recorded.run import RecordedRun
from . import stretches
from .bits import same
from .driven import DrivenController
from .windows import Windows

WORTH_COMPILING = 20_000  # steps: for fewer, loading compiled code takes longer than computing them
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
    controller: str = ""  # the one that was to send the command; empty: not exactly one
    last_ns: int | None = None  # stamp of the last step, where there are many


def compare(
    table: JointTable, stamp_ns: int, quantity: str, computed: Sequence[float]
) -> Iterator[Difference]:
    """Yield each value of a message whose bits are not the computed ones."""
    recorded = table.get(stamp_ns, quantity, len(computed))
    for name, was, now in zip(table.names, recorded, computed, strict=True):
        if not same(was, now):
            yield Difference(stamp_ns, table.topic, f"{quantity}[{name}]", was, now)


def worth_compiling(stamps: Integers, cost: int = 1) -> bool:
    """Return True if compiled code is available, worthwhile, and takes these stamps: they ascend.

    ``cost``: of a step, relative to a controller's.
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
            passed = driven[name].pass_over(records[name], row, last) - row
            if passed:
                row += passed
                yield Checked(stamp_ns, (), passed, name, int(stamps[row - 1]))
                continue
        yield Checked(stamp_ns, _compared(commands, driven[name], stamp_ns), controller=name)
        row += 1


def _records(
    driven: Mapping[str, DrivenController], commands: JointTable, stamps: Integers
) -> dict[str, Windows[stretches.CommandRecord]]:
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
    windows = Windows(lambda rows: disturbances_matrix(messages, rows))
    row = 0
    while row < len(stamps):
        stamp_ns = int(stamps[row])
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        if quick:
            last = int(np.searchsorted(stamps, timeline.next_ns, side="right"))
            begin, matrix = windows.around(row)
            last = min(last - begin, len(matrix))
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
