"""Check an operator's recorded pushes against the simulator's limits and the recorded states."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.units import seconds
from trunk_sim.operator_input import Applied

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun


def not_by_hand(run: RecordedRun) -> Iterator[str]:
    """Yield pushes that no simulator with this run's parameters takes; the replay checks their effect."""
    if not run.count(topics.OPERATOR_PUSH):
        return
    what = f"{topics.OPERATOR_PUSH}: "
    limits = run.config("simulator").operator_limits
    table = run.table(topics.OPERATOR_PUSH)
    if limits is None:
        yield f"{what}{len(table)} messages, but operator.force and operator.torque are 0"
        return
    odd = np.setdiff1d(table.stamp_ns, run.table(topics.GROUND_TRUTH).stamp_ns)
    if len(odd):
        yield f"{what}a message at t = {seconds(int(odd[0])):g} s, where there is no state"
    efforts = table.values("effort").tolist()
    for stamp_ns, values in zip(table.stamp_ns.tolist(), efforts, strict=True):
        if len(values) != 2 or limits.clip(Applied._make(values)) != tuple(values):
            at = seconds(stamp_ns)
            yield f"{what}what acts from t = {at:g} s on is beyond the operator's limits"
