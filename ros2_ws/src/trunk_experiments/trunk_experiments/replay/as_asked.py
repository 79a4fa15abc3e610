"""Could what an operator did be what was asked for? Each value that acted, against the requests on record."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.units import nanoseconds, seconds
from trunk_sim.operator_input import NOTHING, Applied

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun


def not_as_asked(run: RecordedRun) -> Iterator[str]:
    """Yield where the operator's force and torque are not what a simulator makes of its requests."""
    changes = run.operated.changes
    if not changes:
        return
    what = f"{topics.OPERATOR_APPLIED}: "
    limits = run.config("simulator").operator_limits
    if limits is None:
        yield f"{what}{len(changes)} messages, but operator.force and operator.torque are 0"
        return
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    odd = np.setdiff1d([at_ns for at_ns, _ in changes], truth)
    if len(odd):
        yield f"{what}a message at t = {seconds(int(odd[0])):g} s, where there is no state"
    for (_, before), (at_ns, applied) in pairwise([(-1, NOTHING), *changes]):
        if applied == before:
            yield f"{what}nothing changes at t = {seconds(at_ns):g} s"
    if run.mode == "offline":
        return  # who repeats a run asks for nothing
    longest_ns = 2 * limits.timeout_ns + run.config("simulator").period_ns
    until_ns = inf if run.branch is None else nanoseconds(run.branch.at)
    requests = run.table(topics.OPERATOR_REQUEST)
    order = np.argsort(requests.stamp_ns, kind="stable")
    stamps = requests.stamp_ns[order]
    efforts = requests.values("effort")[order]
    ends = [at_ns for at_ns, _ in changes[1:]] + [int(truth.max(initial=0))]
    for (at_ns, applied), end_ns in zip(changes, ends, strict=True):
        if applied == NOTHING or at_ns >= until_ns:
            continue
        # Each request is taken at most the timeout after its state, and holds for as long.
        first, last = np.searchsorted(stamps, [at_ns - limits.timeout_ns, at_ns + 1])
        asked = [limits.clip(Applied._make(one)) for one in efforts[first:last].tolist()]
        if applied not in asked:
            yield f"{what}what acts from t = {seconds(at_ns):g} s on was asked for by nobody"
        later = stamps[(stamps > at_ns) & (stamps < end_ns)]
        words = [at_ns, *later.tolist(), min(end_ns, until_ns)]
        if max(after - before for before, after in pairwise(words)) > longest_ns:
            yield f"{what}what acts from t = {seconds(at_ns):g} s on lasts longer than it was asked for"
