"""Steps of a real-time run that were made without the answer to their state."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.source import ARRIVAL, NO_SOURCE

from ..recorded.inputs import RecordedInputs

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun


class Late(NamedTuple):
    """Steps that were made without the answer to their state, of how many."""

    late: int
    steps: int


def late_steps(run: RecordedRun, since_ns: int = 0) -> Late | None:
    """Return how many steps were made without the answer to their state; None where time was exact.

    A step is in time if the command in force answers its state or, where a controller answers only some
    states, the last of those; and if the disturbance in force is that of its state. Both are on record.
    A node of somebody else's that answers fewer states than there are has a rate of its own: it may be one
    state off. A command without a state's stamp is neither late nor in time.
    """
    copy = bool(run.exact and run.count(topics.PLANT_INPUTS))  # of a real-time run: without sources
    if not (run.real_time or copy) or "simulator" not in run.parameters:
        return None
    stamps = np.unique(run.table(topics.GROUND_TRUTH).stamp_ns)[:-1]
    stamps = stamps[stamps >= since_ns]
    inputs = RecordedInputs(run, stamps)
    force = inputs.over(slice(None))
    periods = {name: run.config(name).period_ns for name in run.judgeable}
    if copy and not run.external:
        periods[NO_SOURCE] = max(periods.values(), default=0)
    step_ns = run.config("simulator").period_ns
    every_ns = [
        _usual_gap_ns(run, step_ns)
        if name == NO_SOURCE and name not in periods
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
