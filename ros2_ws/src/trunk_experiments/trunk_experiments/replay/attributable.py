"""Until when a run's messages can be attributed: one simulator, one controller at a time, no stranger."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event

from ..plans.nodes import CONTROLLERS

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Integers

    from ..recorded.run import RecordedRun


def shared_from_ns(run: RecordedRun) -> int | None:
    """Return the first stamp at which the run may not have been alone; None if it always was.

    One simulator's stamps increase, and each state has one answer, by a controller that stays. Where that
    ends, a second simulator or controller publishes, or one was started anew: from there on no message can
    be attributed.
    """
    found: list[int] = []
    for relative in (topics.GROUND_TRUTH, topics.JOINT_STATES):
        stamps = run.table(relative).stamp_ns
        places = np.flatnonzero(np.diff(stamps) <= 0)
        if len(places):
            found.append(_before_fall(stamps, int(places[0])))
    # A file does not keep the order between publishers: of two controllers' commands too.
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    answers = np.sort(commands)
    found += answers[1:][np.diff(answers) == 0][:1].tolist()
    if (run.recording.end or {}).get("complete") != "true":
        truth = run.table(topics.GROUND_TRUTH).stamp_ns
        found += _of_a_stranger(commands, run.table(topics.JOINT_STATES).stamp_ns)
        if run.count(topics.DISTURBANCE) and "disturbance" in run.parameters:
            disturbances = run.table(topics.DISTURBANCE).stamp_ns
            doubled = np.sort(disturbances)
            found += doubled[1:][np.diff(doubled) == 0][:1].tolist()
            ahead = truth + run.config("disturbance").period_ns
            found += _of_a_stranger(disturbances, np.concatenate([truth, ahead]))
    return min([*found, *_replaced(run)], default=None)


def _before_fall(stamps: Integers, place: int) -> int:
    """Return the last stamp before time falls back after a place, without a single one far ahead of all.

    What comes after the fall must not be mistaken for what came before it.
    """
    ahead = place > 0 and stamps[place + 1] > stamps[place - 1]
    before = stamps[: place + (0 if ahead else 1)].max()
    return int(min(before, stamps[place + 1 :].min()))


def _of_a_stranger(stamps: Integers, known: Integers) -> Iterator[int]:
    """Yield the last stamp before the first message that belongs to no state; the first one, if none is."""
    rows = np.flatnonzero(~np.isin(stamps, known))
    if len(rows):
        yield int(stamps[: rows[0]].max(initial=known.min(initial=0)))


def _replaced(run: RecordedRun) -> Iterator[int]:
    """Yield when a controller had ended, by its last word, whose place another one took after that.

    Nor can one be told from another of the same name that was started later.
    """
    active: set[str] = set()
    ended: dict[str, int] = {}
    for event in run.events if run.mode != "offline" else ():
        node = run.recording.relative(event.node)
        if node not in CONTROLLERS:
            continue
        if event.message in (Event.PUBLISHED, Event.FAILED):
            ended.setdefault(node, event.stamp_ns)
        elif event.message in (Event.CONFIGURED, Event.ACTIVATED) and ended:
            places = [stamp_ns for one, stamp_ns in ended.items() if one in active or one == node]
            if places:
                yield min(places)
                return
        if event.message == Event.ACTIVATED:
            active.add(node)
        elif event.message in (Event.DEACTIVATED, Event.CLEANED_UP):
            active.discard(node)
