"""Which controller acted when, by its recorded updates or by its events."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.joint_table import Bools, Integers
from trunk_msgs_util.units import seconds

from ..plans.timeline import begins_active

if TYPE_CHECKING:
    from .run import RecordedRun


class Turn(NamedTuple):
    """A controller acts from its first update at ``start``, in s, until the next turn begins."""

    start: float
    controller: str


def acting(stamps: Integers, turns: Iterable[tuple[int, bool]], begins: bool) -> Bools:
    """Return for each stamp, ns, whether a controller acts there, by its turns in their order.

    A turn is a stamp, ns, and True if it makes the controller active; it takes effect after its stamp.
    ``begins``: the controller acts from the start, although no turn says so.
    """
    mask = np.zeros(len(stamps), bool)
    since: int | None = -1 if begins else None
    for stamp_ns, active in turns:
        if active:
            since = stamp_ns
        elif since is not None:
            mask |= (stamps > since) & (stamps <= stamp_ns)
            since = None
    return mask if since is None else mask | (stamps > since)


def acts(run: RecordedRun, controller: str, stamps: Integers) -> Bools:
    """Return for each stamp, ns, whether a controller is active there, by its events and parameters.

    Raises RecordingError and ParameterError as `RecordedRun.changes` and `config` do.
    """
    changes = run.changes(controller)
    turns = [
        (change.stamp_ns, change.event == Event.ACTIVATED)
        for change in sorted(changes, key=lambda change: change.stamp_ns)
        if change.values is None and change.event != Event.RESET
    ]
    return acting(stamps, turns, begins_active(run.config(controller), changes))


def idle_ns(run: RecordedRun) -> Integers:
    """Return the stamps, ns, of the states of an offline run that no controller was to answer.

    That is between two controllers that were switched by hand. In a graph this is not known: in
    lock-step the plant waits for an answer, and in real time an answer may be late. Raises RecordingError
    and ParameterError as `RecordedRun.changes` and `config` do.
    """
    stamps = run.table(topics.GROUND_TRUTH).stamp_ns
    if run.mode != "offline" or run.another_controller:
        return stamps[:0]
    anybody = np.zeros(len(stamps), bool)
    for name in run.controllers:
        anybody |= acts(run, name, stamps)
    idle: Integers = stamps[~anybody]
    return idle


def recorded_turns(run: RecordedRun) -> tuple[Turn, ...]:
    """Return the turns in order: one for a single controller, none without a controller.

    An external controller acts from the start until one of the project's updates.
    """
    names = run.judgeable if run.external else run.controllers
    states = run.series({topics.controller_state(name): () for name in names})
    stamps = [state.stamp_ns for state in states.values()]
    before = (Turn(0.0, run.external),) if run.external else ()
    if not stamps or not any(map(len, stamps)):
        return before
    who = np.repeat(np.arange(len(names)), [len(s) for s in stamps])
    when = np.concatenate(stamps)
    order = np.argsort(when, kind="stable")
    who, when = who[order], when[order]
    first = np.flatnonzero(np.diff(who, prepend=-1))
    ours = tuple(
        Turn(seconds(stamp_ns - run.begin_ns), names[index])
        for stamp_ns, index in zip(when[first].tolist(), who[first].tolist(), strict=True)
    )
    return ours if ours[0].start <= 0.0 else before + ours
