"""Warnings before every result of a run: it is incomplete, the trunk fell, real time was not kept.

In real time a command may come too late for its step, and the run then differs from its plan.
How many steps were late follows from the record; how far that moved the angle, from the same plan in
lock-step.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.events import ENDS, Event, as_count
from trunk_msgs_util.recording.topic import fields_of
from trunk_msgs_util.source import ARRIVALS
from trunk_msgs_util.units import NANOSECONDS, seconds

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_table import Integers
    from trunk_msgs_util.recording.reader import Recording

    from ..recorded.run import RecordedRun

MOST_STEPS = 4_000_000  # of the integrator, likewise
LONGEST_TWIN = 200_000  # states that are simulated again to tell how far a run was moved
# A state is far from the one before it beyond this time and this many of the usual steps.
_FAR_NS, _FAR_STEPS = NANOSECONDS, 100


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
    leans_deg: float | None = (
        None  # the last angle, beyond 90 degrees although no fall is on record
    )
    limit_deg: float | None = None  # the fall angle in force then
    refused: tuple[
        str, ...
    ] = ()  # messages that were not used, or not as they were meant: a line each
    external: bool = False  # somebody else's node gave the commands
    silent: str = ""  # that nobody held the trunk, or not to the end; a line

    def __bool__(self) -> bool:
        fell = self.fell_at_s is not None or self.leans_deg is not None
        said = self.silent or self.incomplete or self.refused
        return bool(said or fell or self.late or self.moved_deg)

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
        lines = [self.silent] if self.silent else []
        if self.incomplete:
            until = f"; {self.until}" if self.until else ""
            lines.append(f"INCOMPLETE: {self.incomplete}{until}")
        if self.fell_at_s is not None:
            angle = "" if self.fell_angle_deg is None else f", {self.fell_angle_deg:.0f} degrees"
            lines.append(f"FELL: at t = {self.fell_at_s:g} s{angle}")
        if self.leans_deg is not None:
            limit = (
                ""
                if self.limit_deg is None
                else f", but fall.angle is {self.limit_deg:.3g} degrees"
            )
            lines.append(f"BEYOND 90 degrees: it ends at {self.leans_deg:.0f} degrees{limit}")
        lines += self.refused
        if self.late or self.moved_deg:
            moved = ""
            if self.moved_deg is not None:
                moved = f"; in lock-step the angle differs by up to {self.moved_deg:.3g} degrees"
            slow = (
                "the machine or your node was too slow"
                if self.external
                else "the machine was too busy"
            )
            lines.append(
                f"LATE: {slow}, {self.late} of {self.steps} steps late{moved}: "
                "--lockstep gives the exact run"
            )
        return lines

    def as_values(self, judged: str | None = None) -> dict[str, object]:
        """Return plain values, for JSON; ``judged``: the verdict, if the run has been recomputed."""
        return {
            "complete": not self.incomplete,
            "reason": self.incomplete or None,
            "ends_at_s": self.ends_at_s,
            "planned_s": self.planned_s,
            "fell": self.fell_at_s,
            "fell_angle_deg": self.fell_angle_deg,
            "beyond_90": None
            if self.leans_deg is None
            else {"angle_deg": self.leans_deg, "fall_angle_deg": self.limit_deg},
            "silent": self.silent or None,
            "refused": list(self.refused),
            "late": {"steps": self.late, "of": self.steps, "moved_deg": self.moved_deg}
            if self.steps
            else None,
            "judged": judged,
        }


def doubts_of(run: RecordedRun, twin: bool = True, whole: bool = True) -> Doubts:
    """Return the doubts about a run; ``twin``: simulate it in lock-step, if it was in real time.

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
    late = None
    if whole and (run.real_time or run.count(topics.PLANT_INPUTS)):
        from .late import late_steps  # with the plant, which an exact run's doubts need not load

        # Messages or parameters that cannot be read are reported elsewhere.
        with suppress(TrunkError):
            late = late_steps(run)
    moved = moved_deg(run) if twin and late is not None else None
    return Doubts(
        *_incomplete(run),
        None if fall is None else seconds(fall.stamp_ns),
        angle,
        late.late if late else 0,
        late.steps if late else 0,
        moved,
        *(_leans(run) if whole and fall is None else (None, None)),
        tuple(refused(run, whole)),
        bool(run.external),
        silence(run),
    )


def stamp_doubts(run: RecordedRun) -> list[str]:
    """Return a line if the states' stamps cannot all be right: doubled, backward, far, invalid.

    Only time that passes evenly gives integrals a meaning. What comes before what is by log time, as MCAP
    gives messages no order.
    """
    relative = topics.JOINT_STATES if run.another_robot else topics.GROUND_TRUTH
    name = run.recording.topic(relative)
    topic = run.recording.topics.get(name)
    if topic is None or topic.readable < 2:
        return []
    if topic.rising and not topic.overflowing and topic.longest_step_ns <= _FAR_NS:
        return []
    stamp_ns, log_ns = _times(run, relative)
    stamps = np.unique(stamp_ns)
    if len(stamps) < 2:
        at = f"t = {seconds(int(stamp_ns[0])):.9g} s"
        return [f"STAMPS: {name}: all {len(stamp_ns)} have {at}: no time passes"]
    steps = np.diff(stamps)
    far = steps > max(_FAR_NS, _FAR_STEPS * float(np.median(steps)))
    backward = np.diff(stamp_ns[np.argsort(log_ns, kind="stable")]) < 0
    counts = {
        "doubled": len(stamp_ns) - len(stamps),
        "backward": int(np.count_nonzero(backward)),
        f"far (up to {seconds(int(steps.max())):.3g} s after the one before)": int(far.sum()),
        "with 1e9 nanoseconds or more": topic.overflowing,
    }
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    return [f"STAMPS: {name}: of {len(stamp_ns)}: {kinds}"] if kinds else []


def _times(run: RecordedRun, relative: str) -> tuple[Integers, Integers]:
    """Return the states' stamps and log times, in ns; of another robot's, those that our controllers use."""
    if run.another_robot:
        table = run.table(relative)
        return table.stamp_ns, table.log_time_ns
    name = run.recording.topic(relative)
    parts = []
    for block in run.recording.blocks([name]):
        sec, nanosec = fields_of(block[name])
        parts.append((sec * NANOSECONDS + nanosec, block[name].log_time_ns))
    stamp_ns, log_ns = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return stamp_ns, log_ns


def refused(run: RecordedRun, whole: bool = True) -> Iterator[str]:
    """Yield the inputs that nodes did not use, or took otherwise than meant: how many, and why.

    With ``whole`` states whose stamps cannot be right come first.
    """
    if whole:
        with suppress(TrunkError):  # messages that cannot be read are reported elsewhere
            yield from stamp_doubts(run)
        with suppress(TrunkError):
            yield from _idle(run)
    reasons: dict[tuple[str, str], str] = {}
    counts: dict[tuple[str, str], int] = {}
    for event in run.events:
        if event.message != Event.REFUSED:
            continue
        node = run.recording.relative(event.node)
        if "what" in event.values:
            reasons.setdefault((node, event.values["what"]), event.values.get("why", ""))
        else:
            counts |= {(node, kind): as_count(text) for kind, text in event.values.items()}
    for (node, kind), why in reasons.items():
        word = "STAMPS" if kind in ARRIVALS else "REFUSED"
        count = counts.get((node, kind), -1)
        number = str(count) if count >= 0 else "some"
        yield f"{word}: {node}: {number} {kind}: {why}"


def _idle(run: RecordedRun) -> Iterator[str]:
    """Yield the pulses of a real-time run that never acted."""
    if run.real_time and run.count(topics.PLANT_INPUTS) and "disturbance" in run.parameters:
        from ..recorded.inputs import idle_pulses  # with the plant: an exact run needs none

        for pulse in idle_pulses(run):
            span = f"t = {pulse.start:g} to {pulse.end:g} s"
            yield f"NOT IN FORCE: disturbance: {pulse.magnitude:g} on {pulse.channel}, {span}, never acted"


_SILENT_S = 1.0  # at a run's end: a busy machine holds a controller up for less


def silence(run: RecordedRun) -> str:
    """Return a line if nobody's command was in force in a real-time run, or none at its end; else nothing.

    The simulator counts the steps; where it did not, nothing is known. A controller that was deactivated is
    meant to be silent.
    """
    end = next(
        (e for e in reversed(run.events) if e.message in ENDS and "commanded" in e.values), None
    )
    if end is None:
        return ""
    states, commanded, silent = (
        as_count(end.values.get(name, "")) for name in ("states", "commanded", "silent")
    )
    steps = states - 1
    if not 0 <= commanded <= steps or not 0 <= silent <= steps or not steps:
        return ""
    silent_ns = end.stamp_ns * silent // steps
    turns = {
        event.node: event.message
        for event in run.events
        if event.message in (Event.ACTIVATED, Event.DEACTIVATED)
    }
    ours = {turns.get(run.recording.topic(name)) for name in run.controllers}
    left = not run.external and ours == {Event.DEACTIVATED}
    if commanded and (silent_ns <= _SILENT_S * NANOSECONDS or left):
        return ""
    names = run.acting or run.recording.provenance.get("controller", "").split()
    who = ", ".join(names) or "nobody"
    refused_ones = any(
        event.message == Event.REFUSED and event.values.get("what", "").startswith("commands ")
        for event in run.events
    )
    gave = "gave no command that the plant takes" if refused_ones else "gave no command"
    after = f" after t = {seconds(end.stamp_ns - silent_ns):g} s" if commanded else ""
    return f"SILENT: {who} {gave}{after} ({commanded} of {steps} steps)"


def _leans(run: RecordedRun) -> tuple[float | None, float | None]:
    """Return the last true angle if it is beyond 90 degrees, and the fall angle in force, in degrees."""
    if not run.count(topics.GROUND_TRUTH):
        return None, None
    try:
        column = ("position", run.joint_names(topics.GROUND_TRUTH)[1])
        truth = run.series({topics.GROUND_TRUTH: [column]})[topics.GROUND_TRUTH]
        angle = degrees(float(truth.column(*column)[-1]))
        if abs(angle) <= 90.0:
            return None, None
        timeline = run.timeline("simulator")
        timeline.advance(int(truth.stamp_ns[-1]) + 1)
        limit = degrees(timeline.config.fall_angle)
    except (TrunkError, KeyError, IndexError):
        return None, None
    return angle, limit


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


def moved_deg(run: RecordedRun) -> float | None:
    """Return by how many degrees the angle departs, at most, from the same plan in lock-step.

    None if that cannot be simulated: a plan with parts that were not recorded, or a long one.
    """
    from trunk_sim.simulation import DivergedError

    from ..recorded.plan import plan_of
    from ..runs.engine import states_of_run
    from ..runs.states import POSITION

    truth = run.table(topics.GROUND_TRUTH)
    if not 0 < len(truth) <= LONGEST_TWIN or truth.width("position") != 2:
        return None
    angles = truth.values("position")[np.argsort(truth.stamp_ns, kind="stable")][:, 1]
    worst = 0.0
    try:
        plan = plan_of(run, in_time=True)
        if len(truth) * plan.simulator.substeps > MOST_STEPS:
            return None
        for states in states_of_run(plan):
            own = states.table[:, POSITION][: len(angles) - states.first, 1]
            apart = np.abs(angles[states.first : states.first + len(own)] - own)
            worst = max(worst, float(apart.max(initial=0.0)))
    except DivergedError:
        return None
    except TrunkError:
        return None
    return degrees(worst)
