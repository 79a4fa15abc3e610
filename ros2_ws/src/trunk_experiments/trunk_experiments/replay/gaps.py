"""Are all steps there, once each and in order? The stamps of each topic, and between topics."""

from __future__ import annotations

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Integers
from trunk_msgs_util.units import seconds

from ..recorded.run import RecordedRun
from ..recorded.turns import exact_from_ns, idle_ns


def gaps(run: RecordedRun, period_ns: int) -> list[str]:
    """Return what is wrong with the stamps of each topic, and between topics."""
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    found = _missing(topics.GROUND_TRUTH, *absent_steps(truth, period_ns))
    for relative in (
        topics.GROUND_TRUTH,
        topics.JOINT_STATES,
        topics.EFFORT_COMMAND,
        topics.DISTURBANCE,
    ):
        if relative == topics.DISTURBANCE and not run.count(relative):
            continue
        stamps = run.table(relative).stamp_ns
        if relative == topics.EFFORT_COMMAND and len(run.controllers) > 1:
            stamps = np.sort(stamps)  # a file does not keep the order between publishers
        found += _disorder(relative, stamps)
        since_ns = 0 if relative == topics.JOINT_STATES else exact_from_ns(run)
        needed = truth[truth >= since_ns]
        if len(needed):
            if relative == topics.DISTURBANCE and run.branch is not None:
                needed = _since_it_joined(run, needed, stamps)
            absent = np.setdiff1d(needed, stamps)
            if relative == topics.EFFORT_COMMAND:
                absent = np.setdiff1d(absent, idle_ns(run))
            found += _missing(relative, len(absent), int(absent[0]) if len(absent) else 0)
    if not len(truth):
        found.append(f"{topics.GROUND_TRUTH}: no messages")
    return found


def _since_it_joined(run: RecordedRun, needed: Integers, stamps: Integers) -> Integers:
    """Return the states that need a disturbance: not those before its node joined at a branch.

    It was quiet by its parameters until then.
    """
    if not len(stamps):
        return needed
    first_ns = int(stamps.min())
    timeline = run.timeline("disturbance")
    quiet = not timeline.config.active
    timeline.advance(first_ns - run.config("simulator").period_ns)
    joined = quiet and not timeline.config.active
    return needed[needed >= first_ns] if joined else needed


def absent_steps(stamps: Integers, period_ns: int) -> tuple[int, int]:
    """Return how many multiples of the period up to the last stamp are missing, and the first, in ns.

    The work is bounded by the number of stamps, whatever their values.
    """
    if not len(stamps):
        return 0, 0
    steps = np.unique(stamps[(stamps >= 0) & (stamps % period_ns == 0)] // period_ns)
    wanted = int(stamps.max()) // period_ns + 1
    gaps = np.flatnonzero(steps != np.arange(len(steps)))
    first = int(gaps[0]) if len(gaps) else len(steps)
    return max(wanted - len(steps), 0), first * period_ns


def _missing(relative: str, count: int, first_ns: int) -> list[str]:
    if not count:
        return []
    return [f"{relative}: {count} steps missing, the first at t = {seconds(first_ns):g} s"]


def _disorder(relative: str, stamps: Integers) -> list[str]:
    steps = np.diff(stamps)
    places = np.flatnonzero(steps <= 0)
    if not len(places):
        return []
    before, after = (int(stamps[places[0] + i]) for i in (0, 1))
    if after == before:
        return [f"{relative}: the stamp t = {seconds(after):g} s appears twice"]
    there_and_back = f"from t = {seconds(before):g} s to t = {seconds(after):g} s"
    return [f"{relative}: stamps go backwards, {there_and_back}"]
