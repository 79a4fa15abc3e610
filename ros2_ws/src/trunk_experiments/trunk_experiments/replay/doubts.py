"""Warnings before every result of a run: it is incomplete, the trunk fell, real time was not kept.

In real time a command may come too late for its step, and the run then differs from its plan.
How many steps were late follows from the record; how far that moved the angle, from the same plan in
lock-step.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trunk_msgs_util import topics
from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.events import Event
from trunk_msgs_util.units import seconds

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Floats, Integers
    from trunk_msgs_util.recording.reader import Recording

    from ..recorded.run import RecordedRun

MOST_STEPS = 4_000_000  # of the integrator, likewise
LONGEST_TWIN = 200_000  # states that are simulated again to tell how far a run was moved


class Late(NamedTuple):
    """Steps that were made without the answer to their state, of how many."""

    late: int
    steps: int


@dataclass(frozen=True)
class Doubts:
    """Why a run's numbers may not be what its plan gives."""

    incomplete: str = ""  # why; empty for a complete recording
    ends_at_s: float | None = None  # the last true state of an incomplete one; None: none is there
    planned_s: float | None = None  # when it was to end; None: never, or not known
    fell_at_s: float | None = None
    fell_angle_deg: float | None = None
    late: int = 0
    steps: int = 0
    moved_deg: float | None = None  # the angle, at most, by what was late; None if not known

    def __bool__(self) -> bool:
        return bool(self.incomplete or self.fell_at_s is not None or self.late or self.moved_deg)

    @property
    def until(self) -> str:
        """Where an incomplete run ends: "ends at 6.24 of 10 s"; empty if complete, or not known."""
        if self.ends_at_s is None:
            return ""
        planned = "" if self.planned_s is None else f" of {self.planned_s:g}"
        return f"ends at {self.ends_at_s:g}{planned} s"

    @property
    def lines(self) -> list[str]:
        """A line for each doubt."""
        found = []
        if self.incomplete:
            until = f"; {self.until}" if self.until else ""
            found.append(f"INCOMPLETE: {self.incomplete}{until}")
        if self.fell_at_s is not None:
            angle = "" if self.fell_angle_deg is None else f", {self.fell_angle_deg:.0f} degrees"
            found.append(f"FELL: at t = {self.fell_at_s:g} s{angle}")
        if self.late or self.moved_deg:
            moved = ""
            if self.moved_deg is not None:
                moved = f"; in lock-step the angle differs by up to {self.moved_deg:.3g} degrees"
            found.append(
                f"LATE: real time was not kept, {self.late} of {self.steps} steps late{moved}"
            )
        return found

    def as_values(self, judged: str | None = None) -> dict[str, object]:
        """Return plain values, for JSON; ``judged``: the verdict, if the run has been recomputed."""
        return {
            "complete": not self.incomplete,
            "reason": self.incomplete or None,
            "ends_at_s": self.ends_at_s,
            "planned_s": self.planned_s,
            "fell": self.fell_at_s,
            "fell_angle_deg": self.fell_angle_deg,
            "late": {"steps": self.late, "of": self.steps, "moved_deg": self.moved_deg}
            if self.steps
            else None,
            "judged": judged,
        }


def doubts_of(run: RecordedRun, twin: bool = True, whole: bool = True) -> Doubts:
    """Return what is doubtful about a run; ``twin``: simulate it in lock-step, if it was in real time.

    Without ``whole`` only events are looked at, not every message.

    Raises RecordingError for messages that cannot be read.
    """
    fall = next((event for event in run.events if event.message == Event.FELL), None)
    angle = None
    if fall is not None:
        try:
            angle = degrees(float(fall.values.get("angle", "")))
        except ValueError:
            angle = None
    try:
        late = late_steps(run) if whole else None
    except TrunkError:  # messages or parameters that cannot be read are reported elsewhere
        late = None
    moved = moved_deg(run) if twin and late is not None else None
    return Doubts(
        *_incomplete(run),
        None if fall is None else seconds(fall.stamp_ns),
        angle,
        late.late if late else 0,
        late.steps if late else 0,
        moved,
    )


def incomplete(run: RecordedRun) -> list[str]:
    """Return a line on why a run is not whole and where it ends; none for a whole one."""
    return Doubts(*_incomplete(run)).lines


def _incomplete(run: RecordedRun) -> tuple[str, float | None, float | None]:
    """Return why a run is not whole, where it ends and where it was to end, in s."""
    recording = run.recording
    if recording.complete:
        return "", None, None
    end = recording.end or {}
    if end.get("complete") == "true":  # as far as the recorder knew
        reason = recording.damage[0]
    else:
        reason = end.get("reason") or _unfinished(recording)
    truth = recording.topics.get(recording.topic(topics.GROUND_TRUTH))
    last_ns = None if truth is None else truth.last_stamp_ns
    last_s = None if last_ns is None else seconds(last_ns)
    planned_s = run.parameters.get("simulator", {}).get("duration")
    if not isinstance(planned_s, float) or planned_s <= 0.0:
        return reason, last_s, None
    if last_s is not None and last_s > planned_s:  # another simulator's: our end is not known
        last_s = None
    return reason, last_s, planned_s


def _unfinished(recording: Recording) -> str:
    """Return why a file that gives no reason is not whole; another program may have recorded it."""
    stranger = recording.unfinished.startswith("recorded by")
    return recording.unfinished if stranger else "the recorder did not finish this file"


def late_steps(run: RecordedRun) -> Late | None:
    """Return how many steps were made without the answer to their state; None where time was exact.

    A step from state k is in time if the torque over it, which true state k + 1 records, is that of the
    command with the stamp of k, or, where a controller answers only some states, of its last.
    """
    if run.mode != "real_time" or "simulator" not in run.parameters:
        return None
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
    from ..recorded.wire import RecordedWire

    sent = RecordedWire(run.config("simulator"), truth.stamp_ns).all_told_ns(at)
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
    from trunk_sim.step import torque_of

    plant = timeline.config.plant
    for k, stamp_ns in enumerate(at.tolist()):
        if timeline.advance(stamp_ns + 1):
            plant = timeline.config.plant
        found[k] = torque_of(float(before[k]), float(wanted[k]), plant) == applied[k]
    return found


def moved_deg(run: RecordedRun) -> float | None:
    """Return by how many degrees the angle departs, at most, from the same plan in lock-step.

    None if that cannot be simulated: a plan with parts that were not recorded, or a long one.
    """
    from trunk_sim.quick import act_for
    from trunk_sim.simulation import DivergedError

    from ..runs.offline import steps

    truth = run.table(topics.GROUND_TRUTH)
    if len(truth) > LONGEST_TWIN:
        return None
    angles = truth.values("position")[np.argsort(truth.stamp_ns, kind="stable")][:, 1].tolist()
    worst = 0.0
    try:
        plan = run.plan()
        if len(truth) * plan.simulator.substeps > MOST_STEPS:
            return None
        for angle, step in zip(angles, steps(plan, act_for(plan.simulator)), strict=False):
            worst = max(worst, abs(angle - step.truth.position[1]))
    except DivergedError:
        return None
    except TrunkError:
        return None
    return degrees(worst)
