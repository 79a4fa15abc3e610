"""Late steps in recordings of earlier versions, which do not say what acted: by the torque on record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from trunk_msgs_util import topics
from trunk_sim.step import torque_of

from ..recorded.inputs import delivered_ns
from .doubts import Late

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Floats, Integers

    from ..recorded.run import RecordedRun


def late_steps_by_torque(run: RecordedRun) -> Late | None:
    """Return how many steps were made without the answer to their state; None for a run of one state.

    A step from state k is in time if the torque over it, which true state k + 1 records, is that of the
    command with the stamp of k, or, where a controller answers only some states, of its last.
    """
    truth, commands = run.table(topics.GROUND_TRUTH), run.table(topics.EFFORT_COMMAND)
    period_ns = run.config("simulator").period_ns
    if len(truth) < 2 or truth.values("effort").shape[1] < 2:
        return None
    rows = np.argsort(truth.stamp_ns, kind="stable")
    at, applied = truth.stamp_ns[rows][:-1], truth.values("effort")[rows][1:, 1]
    if not len(commands) or not commands.values("effort").shape[1]:
        return Late(len(at), len(at))
    order = np.argsort(commands.stamp_ns, kind="stable")
    told, effort = commands.stamp_ns[order], commands.values("effort")[order][:, 0]
    every = 1
    if len(told) > 1:
        every = max(1, int(np.median(np.diff(told)) // period_ns))
    sent = delivered_ns(run.config("simulator"), at)
    row = np.searchsorted(told, sent, side="right") - 1
    known = row >= 0
    age = np.where(known, sent - told[row], np.iinfo(np.int64).max)
    wanted = np.where(known, effort[row], np.nan)
    age[sent < 0], wanted[sent < 0] = 0, 0.0  # the link delivered no command
    limits = {float(run.config("simulator").max_effort)}
    changed = [one.changed.get("max_effort") for one in run.parameter_changes("simulator")]
    limits |= {limit for limit in changed if isinstance(limit, float)}
    acted = applied == wanted
    for limit in limits:
        acted |= applied == np.clip(wanted, -limit, limit)
    before = truth.values("effort")[rows][:-1, 1]
    acted |= _driven(run, at, before, wanted, applied)
    in_time = acted & (age < every * period_ns)
    return Late(int(np.count_nonzero(~in_time)), len(at))


def _driven(
    run: RecordedRun, at: Integers, before: Floats, wanted: Floats, applied: Floats
) -> NDArray[np.bool_]:
    """Return where the torque is what a drive that is not ideal makes of the wanted one."""
    found = np.zeros(len(at), np.bool_)
    timeline = run.timeline("simulator")
    changed = [name for one in run.parameter_changes("simulator") for name in one.changed]
    if timeline.config.actuator is None and not any(n.startswith("actuator.") for n in changed):
        return found
    plant = timeline.config.plant
    for k, stamp_ns in enumerate(at.tolist()):
        if timeline.advance(stamp_ns + 1):
            plant = timeline.config.plant
        found[k] = torque_of(float(before[k]), float(wanted[k]), plant) == applied[k]
    return found
