"""Facts of a run, from its states and what acted on the plant: a fall, late steps, silence, links' losses.

An event is a log: nothing here follows from one, apart from a controller's turns.
The plant is imported only where its inputs were recorded, and for links.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.recording.joint_table import Floats, Integers
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.source import ARRIVAL, NO_SOURCE
from trunk_msgs_util.units import NANOSECONDS, seconds

from ..results import Count

if TYPE_CHECKING:
    from .run import RecordedRun

_SILENT_S = 1.0  # at a run's end: a busy machine holds a controller up for less


class Fall(NamedTuple):
    """The first state beyond the fall angle in force there."""

    stamp_ns: int
    angle: float  # rad


class Late(NamedTuple):
    """Steps of a real-time run that were made without the answer to their state."""

    steps: Annotated[Count, "Late steps"]
    of: Annotated[Count, "All steps"]
    moved_deg: Annotated[float | None, "By how much at most the angle departs from lock-step"] = (
        None
    )


def joints_of(run: RecordedRun) -> tuple[str, str]:
    """Return the names of the hip's and the trunk's joint.

    Raises RecordingError for a run without true states, or whose true states have other joints.
    """
    names = run.joint_names(topics.GROUND_TRUTH)
    topic = run.recording.topic(topics.GROUND_TRUTH)
    if run.another_robot:
        raise RecordingError(f"{run.path}: a robot that is not ours: its true states are not known")
    if not run.count(topics.GROUND_TRUTH):
        if run.recording.damage:
            damage = run.recording.damage[0].removeprefix(f"{run.path.name}: ")
            raise RecordingError(
                f"{run.path} is damaged, and no messages on {topic} can be read: {damage}; "
                "record the run again"
            )
        raise RecordingError(
            f"{run.path} has no messages on {topic}: record a run with the simulator in it"
        )
    declared = run.parameters.get("simulator", {}).get("joints")
    if isinstance(declared, tuple) and len(declared) == 2:
        joints = str(declared[0]), str(declared[1])
    elif {"hip", "trunk"} <= set(names) or len(names) < 2:
        joints = "hip", "trunk"
    else:
        joints = names[0], names[1]
    for name in joints:
        if name not in names:
            raise RecordingError(
                f"{run.path}: {topic} has no joint {name!r}, "
                f"only {', '.join(names)}: set the parameter joints to its names"
            )
    return joints


def fall_angles(run: RecordedRun, stamps: Integers) -> Floats | None:
    """Return the fall angle in force in each state, rad [N]; None without parameters, NaN for no number.

    A parameter that a recording of an earlier version lacks has its default.
    """
    if "simulator" not in run.parameters:
        return None
    angles = np.full(len(stamps), np.nan)  # where it is not known, nothing is beyond it
    first = run.parameters["simulator"].get("fall.angle")
    if first is None:
        from trunk_sim.config import SimulatorConfig

        first = SimulatorConfig().fall_angle
    settings = [(-1, first)]
    settings += [
        (change.stamp_ns, change.changed["fall.angle"])
        for change in run.parameter_changes("simulator")
        if "fall.angle" in change.changed
    ]
    for since_ns, angle in settings:
        known = isinstance(angle, float | int) and not isinstance(angle, bool)
        angles[stamps > since_ns] = angle if known else np.nan
    return angles


def fall_of(run: RecordedRun) -> Fall | None:
    """Return the first state beyond the fall angle; None if there is none, or it is not known.

    Raises RecordingError for states that cannot be read.
    """
    if not run.count(topics.GROUND_TRUTH) or run.another_robot:
        return None
    stamps, angles = run.angles
    limits = fall_angles(run, stamps)
    if limits is None:
        return None
    beyond = np.abs(angles) > limits
    if not beyond.any():
        return None
    row = int(np.argmax(beyond))
    return Fall(int(stamps[row]), float(angles[row]))


def not_judged(run: RecordedRun) -> tuple[str, ...]:
    """Return what is shown of a run although nothing recomputes it, a line each."""
    follow = "the states follow from the commands"
    if run.another_robot:
        return ("the states, and whether all of them are recorded: another robot published them",)
    if run.another_controller:
        names = ", ".join(run.controllers)
        return (f"the commands and terms of {names}, another controller: {follow}",)
    if run.external:
        return (f"the reference, commands and terms of {run.external}: {follow}",)
    return ()


def links_of(run: RecordedRun) -> dict[str, str]:
    """Return what became of the messages on a run's links.

    Empty without links, if it is not known, and for a large file of which only the summary was read.
    """
    if not run.recording.checked or "simulator" not in run.parameters:
        return {}
    from trunk_sim.links import Traffic

    with suppress(RecordingError, ParameterError):
        network = run.config("simulator").network
        return {} if network is None else Traffic(network).counts(len(run.angles[0]))
    return {}


def silence_of(run: RecordedRun) -> str:
    """Return a clause if no command was in force in a run in real time, or none at its end; else nothing.

    Raises RecordingError for messages that cannot be read.
    """
    if not run.count(topics.PLANT_INPUTS) or "simulator" not in run.parameters:
        return ""
    stamps = run.evidence.stamps
    if len(stamps) < 2:
        return ""
    held = run.evidence.inputs.over(slice(0, len(stamps) - 1)).command_ns >= 0
    commanded = int(np.count_nonzero(held))
    silent = int(np.argmax(held[::-1])) if commanded else len(held)
    since_ns = int(stamps[len(held) - silent])
    if commanded and int(stamps[-1]) - since_ns <= _SILENT_S * NANOSECONDS:
        return ""
    names = run.acting or run.recording.provenance.get("controller", "").split()
    by = f" from {', '.join(names)}" if names else ""
    after = f" after t = {seconds(since_ns):g} s" if commanded else ""
    return f"no command{by} was in force{after} ({commanded} of {len(held)} steps)"


def late_steps(run: RecordedRun, since_ns: int = 0) -> Late | None:
    """Return how many steps were made without the answer to their state; None where time was exact.

    A step is in time if the command in force answers its state or, where a controller answers only some
    states, the last of those; and if the disturbance in force is that of its state. Both are on record.
    An external node that answers fewer states than there are has a rate of its own: it may be one state off.
    A command without a state's stamp is neither late nor in time.
    """
    copy = bool(run.exact and run.count(topics.PLANT_INPUTS))  # of a real-time run: without sources
    if not (run.real_time or copy) or "simulator" not in run.parameters:
        return None
    stamps, inputs = run.evidence.stamps, run.evidence.inputs
    rows = slice(int(np.searchsorted(stamps, since_ns)), max(len(stamps) - 1, 0))
    stamps, force = stamps[rows], inputs.over(rows)
    periods = {name: run.config(name).period_ns for name in run.judgeable}
    if copy and not run.external:
        periods[NO_SOURCE] = max(periods.values(), default=0)
    step_ns = run.config("simulator").period_ns
    every_ns = [
        _usual_gap_ns(run, step_ns)
        if name == NO_SOURCE and name not in periods
        else max(periods.get(name.partition("@")[0], 0), step_ns)
        for name in inputs.sources
    ]
    age_ns = stamps - force.command_ns
    late = (force.command_ns < 0) | (age_ns >= np.array(every_ns)[force.command_source])
    if run.external:
        late &= np.array([name != ARRIVAL for name in inputs.sources])[force.command_source]
        late &= (force.command_ns >= 0).any()
    if run.count(topics.DISTURBANCE):
        late |= force.disturbance_ns != stamps
    return Late(int(np.count_nonzero(late)), len(stamps))


def _usual_gap_ns(run: RecordedRun, step_ns: int) -> int:
    """Return how old an external command may be before it is late, ns, by the states that it answered."""
    stamps = np.unique(run.table(topics.EFFORT_COMMAND).stamp_ns)
    gaps = np.diff(stamps[(stamps >= 0) & (stamps % step_ns == 0)]) // step_ns
    usual = int(np.bincount(np.minimum(gaps, 10_000)).argmax()) if len(gaps) else 1
    return step_ns if usual <= 1 else (usual + 1) * step_ns
