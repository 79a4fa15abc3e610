"""When nobody was to command: between two controllers that somebody switched by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event

from ..plans.timeline import begins_active

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Integers

    from .run import RecordedRun

_TURNS = (Event.ACTIVATED, Event.DEACTIVATED, Event.CLEANED_UP)


def idle_ns(run: RecordedRun) -> Integers:
    """Return the stamps, ns, of the states of an offline run that no controller was to answer.

    In a graph nobody can tell: in lock-step the plant waits for an answer, and in real time an answer may
    be late. Raises RecordingError and ParameterError as `RecordedRun.changes` and `config` do.
    """
    stamps = run.table(topics.GROUND_TRUTH).stamp_ns
    if run.mode != "offline":
        return stamps[:0]
    acting = np.zeros(len(stamps), bool)
    for name in run.controllers:
        changes = run.changes(name)
        since: int | None = -1 if begins_active(run.config(name), changes) else None
        for turn in sorted(changes, key=lambda change: change.stamp_ns):
            if turn.event not in _TURNS or turn.values is not None:
                continue
            if turn.event == Event.ACTIVATED:
                since = turn.stamp_ns if since is None else since
            elif since is not None:
                acting |= (stamps > since) & (stamps <= turn.stamp_ns)
                since = None
        if since is not None:
            acting |= stamps > since
    found: Integers = stamps[~acting]
    return found
