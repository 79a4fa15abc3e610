"""Steps of a real-time run that were made without the answer to their state."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trunk_msgs_util import topics
from trunk_msgs_util.source import ARRIVAL
from trunk_sim.step import torque_of

from ..recorded.inputs import NO_SOURCE, RecordedInputs, delivered_ns

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Floats, Integers

    from ..recorded.run import RecordedRun


class Late(NamedTuple):
    """Steps that were made without the answer to their state, of how many."""

    late: int
    steps: int


def late_steps(run: RecordedRun) -> Late | None:
    """Return how many steps were made without the answer to their state; None where time was exact.

    A step is in time if the command in force answers its state or, where a controller answers only some
    states, the last of those; and if the disturbance in force is that of its state. Both are on record.
    A node of somebody else's that answers fewer states than there are has a rate of its own: it may be one
    state off. A command without a state's stamp is neither late nor in time.
    """
    if run.mode != "real_time" or "simulator" not in run.parameters:
        return None
    if not run.count(topics.PLANT_INPUTS):
        return _late_steps_by_torque(run)
    stamps = np.unique(run.table(topics.GROUND_TRUTH).stamp_ns)[:-1]
    inputs = RecordedInputs(run, stamps)
    force = inputs.over(slice(None))
    periods = {name: run.config(name).period_ns for name in run.judgeable}
    step_ns = run.config("simulator").period_ns
    every_ns = [
        _usual_gap_ns(run, step_ns)
        if name == NO_SOURCE
        else max(periods.get(name.partition("@")[0], 0), step_ns)
        for name in inputs.sources
    ]
    age_ns = stamps - force.command_ns
    late = (force.command_ns < 0) | (age_ns >= np.array(every_ns)[force.command_source])
    if run.external:
        late &= np.array([name != ARRIVAL for name in inputs.sources])[force.command_source]
        late &= (force.command_ns >= 0).any()
    if run.count(topics.DISTURBANCE):
        late |= force.disturbance_ns != stamps
    return Late(int(np.count_nonzero(late)), len(stamps))


def _usual_gap_ns(run: RecordedRun, step_ns: int) -> int:
    """Return how old a stranger's command may be before it is late, ns, by the states that it answered."""
    stamps = np.unique(run.table(topics.EFFORT_COMMAND).stamp_ns)
    gaps = np.diff(stamps[(stamps >= 0) & (stamps % step_ns == 0)]) // step_ns
    usual = int(np.bincount(np.minimum(gaps, 10_000)).argmax()) if len(gaps) else 1
    return step_ns if usual <= 1 else (usual + 1) * step_ns


def _late_steps_by_torque(run: RecordedRun) -> Late | None:
    """Return how many steps were late in a recording of an earlier version, by the torque on record.

    A step from state k is in time if the torque over it, which true state k + 1 records, is that of the
    command with the stamp of k, or, where a controller answers only some states, of its last. None for a
    run of one state.
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
    stamps, effort = commands.stamp_ns[order], commands.values("effort")[order][:, 0]
    every = 1
    if len(stamps) > 1:
        every = max(1, int(np.median(np.diff(stamps)) // period_ns))
    sent = delivered_ns(run.config("simulator"), at)
    row = np.searchsorted(stamps, sent, side="right") - 1
    known = row >= 0
    age = np.where(known, sent - stamps[row], np.iinfo(np.int64).max)
    wanted = np.where(known, effort[row], np.nan)
    age[sent < 0], wanted[sent < 0] = 0, 0.0  # the link delivered no command
    limits = {float(run.config("simulator").max_effort)}
    changed = [change.changed.get("max_effort") for change in run.parameter_changes("simulator")]
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
    """Return the rows whose torque a drive that is not ideal makes of the wanted one."""
    driven = np.zeros(len(at), np.bool_)
    timeline = run.timeline("simulator")
    changed = [name for change in run.parameter_changes("simulator") for name in change.changed]
    if timeline.config.actuator is None and not any(n.startswith("actuator.") for n in changed):
        return driven
    plant = timeline.config.plant
    for k, stamp_ns in enumerate(at.tolist()):
        if timeline.advance(stamp_ns + 1):
            plant = timeline.config.plant
        driven[k] = torque_of(float(before[k]), float(wanted[k]), plant) == applied[k]
    return driven
