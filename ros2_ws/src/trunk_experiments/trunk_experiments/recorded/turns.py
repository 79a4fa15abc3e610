"""Which controller acted when, according to the recorded commands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.units import seconds

from .run import RecordedRun


class Turn(NamedTuple):
    """A controller acts from its first update at ``start``, in s, until the next turn begins."""

    start: float
    controller: str


def recorded_turns(run: RecordedRun) -> tuple[Turn, ...]:
    """Return the turns in order: one for a single controller, none without a controller."""
    names = run.controllers
    stamps = [run.joints(topics.controller_state(name)).by_stamp().stamp_ns for name in names]
    if not stamps:
        return ()
    who = np.repeat(np.arange(len(names)), [len(s) for s in stamps])
    when = np.concatenate(stamps)
    order = np.argsort(when, kind="stable")
    who, when = who[order], when[order]
    first = np.flatnonzero(np.diff(who, prepend=-1))
    return tuple(
        Turn(seconds(stamp_ns), names[one])
        for stamp_ns, one in zip(when[first].tolist(), who[first].tolist(), strict=True)
    )
