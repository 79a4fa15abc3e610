"""Warnings before every result of a run: it is incomplete, the trunk fell, real time was not kept.

In real time a command may come too late for its step, and the run then differs from its plan.
How many steps were late follows from the record; how far that moved the angle, from the same plan in
lock-step.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np

from trunk_core import topics
from trunk_core.errors import TrunkError
from trunk_core.results import OMITTED, Result
from trunk_core.topics import Event, as_count
from trunk_core.units import NANOSECONDS, seconds
from trunk_msgs_util.source import ARRIVALS
from trunk_recording.reader import Ending

from .recorded_run import (
    Late,
    RecordedRun,
    fall_angles,
    late_steps,
    not_judged,
    silence_of,
)

LONGEST_TWIN = 200_000  # states that are simulated again to tell how far a run was moved
MOST_STEPS = 4_000_000  # of the integrator, likewise
# A state is far from the one before it beyond this time and this many of the usual steps.
_FAR_NS, _FAR_STEPS = NANOSECONDS, 100


Word = Literal["verified", "diverges", "inconclusive"]  # of a verdict


class Beyond(NamedTuple):
    """How a run without a fall ends beyond 90 degrees."""

    angle_deg: Annotated[float, "The last true angle"]
    fall_angle_deg: Annotated[float | None, "The fall angle in force"]


@dataclass(frozen=True)
class Doubts:
    """Why a run's numbers may not be what its plan gives."""

    complete: Annotated[bool, "The recorder finished the file and lost nothing"] = True
    reason: Annotated[str | None, "Why it is not complete; null if it is"] = None
    ends_at_s: Annotated[float | None, "The last true state of an incomplete run, if any"] = None
    planned_s: Annotated[float | None, "When an incomplete run was to end, if ever"] = None
    fell: Annotated[float | None, "Of the first fall, simulated s; null: none is recorded"] = None
    fell_angle_deg: float | None = None
    beyond_90: Annotated[Beyond | None, "A run without a fall that ends beyond 90 degrees"] = None
    silent: Annotated[str | None, "That no command held the trunk, or none at its end"] = None
    unsound: Annotated[
        tuple[str, ...], "Stamps that cannot be right, pulses that never acted: a line each"
    ] = ()
    refused: Annotated[
        tuple[str, ...], "By the nodes' events, messages not used, or not as meant: a line each"
    ] = ()
    late: Annotated[Late | None, "null: time was exact"] = None
    not_judged: Annotated[
        tuple[str, ...], "What is shown, and nothing recomputes: a line each"
    ] = ()
    judged: Annotated[Word | None, "The verdict, where this verb recomputed the run; else null"] = (
        None
    )
    external: Annotated[bool, OMITTED] = False  # an external node gave the commands

    def __bool__(self) -> bool:
        fell = self.fell is not None or self.beyond_90 is not None
        return bool(self.silent or self.reason or self.unsound or fell or self._behind)

    @property
    def _behind(self) -> bool:
        """True if steps were late, or moved."""
        return self.late is not None and bool(self.late.steps or self.late.moved_deg)

    @property
    def until(self) -> str:
        """Where an incomplete run ends: "ends at 6.24 of 10 s"; empty if complete, or not known."""
        if self.ends_at_s is None:
            return ""
        planned = "" if self.planned_s is None else f" of {self.planned_s:g}"
        return f"ends at {self.ends_at_s:g}{planned} s"

    @property
    def of_inputs(self) -> list[str]:
        """A line for each doubt about what acted and what was used."""
        return [*self._silent, *self.unsound, *self.refused]

    @property
    def _silent(self) -> list[str]:
        return [f"SILENT: {self.silent}"] if self.silent else []

    @property
    def lines(self) -> list[str]:
        """A line for each doubt."""
        lines = self._silent
        if self.reason is not None:
            until = f"; {self.until}" if self.until else ""
            lines.append(f"INCOMPLETE: {self.reason}{until}")
        if self.fell is not None:
            angle = "" if self.fell_angle_deg is None else f", {self.fell_angle_deg:.0f} degrees"
            lines.append(f"FELL: at t = {self.fell:g} s{angle}")
        if self.beyond_90 is not None:
            angle_deg, fall_deg = self.beyond_90
            limit = "" if fall_deg is None else f", but fall.angle is {fall_deg:.3g} degrees"
            lines.append(f"BEYOND 90 degrees: it ends at {angle_deg:.0f} degrees{limit}")
        lines += [*self.unsound, *self.refused]
        if self.late is not None and self._behind:
            steps, of, moved_deg = self.late
            moved = ""
            if moved_deg is not None:
                moved = f"; in lock-step the angle differs by up to {moved_deg:.3g} degrees"
            slow = (
                "the machine or your node was too slow"
                if self.external
                else "the machine was too busy"
            )
            lines.append(
                f"LATE: {slow}, {steps} of {of} steps late{moved}: --lockstep gives the exact run"
            )
        return [*lines, *(f"NOT JUDGED: {part}" for part in self.not_judged)]


@dataclass(frozen=True)
class RecordingResult(Result):
    """What every document says about a recording."""

    file: Annotated[Path, "The recording"]
    doubts: Annotated[Doubts | None, "null: not read, or cannot be read"]


def about(
    run: RecordedRun, doubts: Doubts | None = None, judged: Word | None = None
) -> RecordingResult:
    """Return a run's file and its doubts; ``judged``: the verdict, if the run has been recomputed.

    Without ``doubts`` they are looked for here, without simulating a lock-step twin; None if unknown.
    """
    if doubts is None:
        try:
            doubts = doubts_of(run, twin=False)
        except TrunkError:  # messages that cannot be read
            return RecordingResult(run.path, None)
    return RecordingResult(run.path, replace(doubts, judged=judged))


def doubts_of(run: RecordedRun, twin: bool = True) -> Doubts:
    """Return the doubts about a run; ``twin``: simulate it in lock-step, if it was in real time.

    Raises RecordingError for messages that cannot be read.
    """
    fall, silent, late = None, "", None
    # Messages or parameters that cannot be read are reported elsewhere.
    with suppress(TrunkError):
        fall = run.fall
    with suppress(TrunkError):
        silent = silence_of(run)
    with suppress(TrunkError):
        late = late_steps(run)
    if twin and late is not None:
        late = late._replace(moved_deg=moved_deg(run))
    return Doubts(
        *_completeness(run),
        None if fall is None else seconds(fall.stamp_ns),
        None if fall is None else degrees(fall.angle),
        _beyond(run) if fall is None else None,
        silent or None,
        tuple(unsound(run)),
        tuple(refused(run)),
        late if late and late.of else None,
        not_judged(run),
        external=bool(run.external),
    )


def stamp_doubts(run: RecordedRun) -> list[str]:
    """Return a line if the states' stamps cannot all be right: doubled, backward, far, invalid.

    Only time that passes evenly gives integrals a meaning. What comes before what is by log time, as MCAP
    gives messages no order.
    """
    relative = topics.JOINT_STATES if run.another_robot else topics.GROUND_TRUTH
    name = run.topic(relative)
    topic = run.recording.topics.get(name)
    if topic is None or topic.readable < 2 or not run.recording.checked:
        return []
    if topic.rising and not topic.overflowing and topic.longest_step_ns <= _FAR_NS:
        return []
    # Of another robot's states, those that our controllers use.
    table = run.table(relative) if run.another_robot else run.recording.tables({name: ()})[name]
    stamp_ns, stamps = table.stamp_ns, np.unique(table.stamp_ns)
    if len(stamps) < 2:
        at = f"t = {seconds(int(stamp_ns[0])):.9g} s"
        return [f"STAMPS: {name}: all {len(stamp_ns)} have {at}: no time passes"]
    steps = np.diff(stamps)
    far = steps > max(_FAR_NS, _FAR_STEPS * float(np.median(steps)))
    backward = np.diff(stamp_ns[np.argsort(table.log_time_ns, kind="stable")]) < 0
    counts = {
        "doubled": len(stamp_ns) - len(stamps),
        "backward": int(np.count_nonzero(backward)),
        f"far (up to {seconds(int(steps.max())):.3g} s after the one before)": int(far.sum()),
        "with 1e9 nanoseconds or more": topic.overflowing,
    }
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    return [f"STAMPS: {name}: of {len(stamp_ns)}: {kinds}"] if kinds else []


def unsound(run: RecordedRun) -> Iterator[str]:
    """Yield states whose stamps cannot be right, then pulses of a real-time run that never acted."""
    with suppress(TrunkError):  # messages that cannot be read are reported elsewhere
        yield from stamp_doubts(run)
    with suppress(TrunkError):
        if run.real_time and run.count(topics.PLANT_INPUTS) and "disturbance" in run.parameters:
            from .evidence import idle_pulses  # with the plant: an exact run needs none

            for pulse in idle_pulses(run):
                acts = f"{pulse.magnitude:g} on {pulse.channel}"
                span = f"t = {pulse.start:g} to {pulse.end:g} s"
                yield f"NOT IN FORCE: disturbance: {acts}, {span}, never acted"


def refused(run: RecordedRun) -> Iterator[str]:
    """Yield the inputs that nodes did not use, or took otherwise than meant: how many, and why."""
    reasons: dict[tuple[str, str], str] = {}
    counts: dict[tuple[str, str], int] = {}
    for event in run.events:
        if event.message != Event.REFUSED:
            continue
        node = run.relative(event.node)
        if "what" in event.values:
            reasons.setdefault((node, event.values["what"]), event.values.get("why", ""))
        else:
            counts |= {(node, kind): as_count(text) for kind, text in event.values.items()}
    for (node, kind), why in reasons.items():
        word = "STAMPS" if kind in ARRIVALS else "REFUSED"
        count = counts.get((node, kind), -1)
        number = str(count) if count >= 0 else "some"
        yield f"{word}: {node}: {number} {kind}: {why}"


def _beyond(run: RecordedRun) -> Beyond | None:
    """Return the last true angle if it is beyond 90 degrees, and the fall angle in force; else None."""
    try:
        stamps, angles = run.angles
        angle = degrees(float(angles[-1]))
        limits = fall_angles(run, stamps[-1:])
    except (TrunkError, KeyError, IndexError):
        return None
    limit = None if limits is None else degrees(float(limits[0]))
    return Beyond(angle, limit) if abs(angle) > 90.0 else None


def incomplete(run: RecordedRun) -> list[str]:
    """Return a line on why a run is not whole and where it ends; none for a whole one."""
    return Doubts(*_completeness(run)).lines


def _completeness(run: RecordedRun) -> tuple[bool, str | None, float | None, float | None]:
    """Return whether a run is whole; if not, why, where it ends and where it was to end, in s."""
    recording = run.recording
    if recording.complete:
        return True, None, None, None
    end = recording.end or {}
    if end.get("complete") == "true":  # as far as the recorder knew
        reason = recording.damage[0]
    else:
        cut = recording.ending is Ending.CUT
        unfinished = "the recorder did not finish this file" if cut else recording.unfinished
        reason = end.get("reason") or unfinished
    truth = recording.topics.get(run.topic(topics.GROUND_TRUTH))
    last_ns = None if truth is None else truth.last_stamp_ns
    last_s = None if last_ns is None else seconds(last_ns)
    planned_s = run.parameters.get("simulator", {}).get("duration")
    if not isinstance(planned_s, float) or planned_s <= 0.0:
        return False, reason, last_s, None
    if last_s is not None and last_s > planned_s:  # another simulator's: our end is not known
        last_s = None
    return False, reason, last_s, planned_s


def moved_deg(run: RecordedRun) -> float | None:
    """Return by how many degrees the angle departs, at most, from the same plan in lock-step.

    None if that cannot be simulated: a plan with parts that were not recorded, or a long one.
    """
    from trunk_runs.engine import POSITION, states_of_run
    from trunk_sim.simulation import DivergedError

    from .repetition import plan_of

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
