"""A recording's states and commands for replay.c: what the exported controller has to answer, bit by bit."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from struct import pack

from trunk_control.decide import Reading, active_at
from trunk_control.law import Hip
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import values_of
from trunk_msgs_util.units import NANOSECONDS, seconds

from ..errors import PlanError
from ..plans.timeline import Change
from ..recorded.run import RecordedRun
from .controller import ExportedController, ExportedStep

MAGIC = 0x54524E4B43303031  # in the byte order of the target
SWINGING = 2000  # states, where there is no recording


def recorded_rows(run: RecordedRun, e: ExportedController) -> list[ExportedStep]:
    """Return the states that a controller of a recording got, and its commands.

    Raises PlanError for a run whose commands do not follow from its states and these parameters alone.
    """
    plan = run.plan()
    name = e.law.name
    if name not in plan.controllers:
        raise PlanError(
            f"--like {run.path}: {', '.join(plan.controllers) or 'no controller of ours'} ran in it, "
            f"not {name}: give a recording with {name}"
        )
    _check_parameters(run, e)
    if plan.inputs is not None:
        raise PlanError(
            f"--like {run.path}: it ran in real time, and the controller did not get every state: "
            "give an offline run or one in lock-step"
        )
    # That it acts from the first state on is an event of a run in the graph.
    begins = Change(-1, None, Event.ACTIVATED)
    changes = [change for change in plan.changes.get(name, ()) if change != begins]
    if changes:
        at = seconds(changes[0].stamp_ns)
        raise PlanError(
            f"--like {run.path}: {name} was changed, reset or switched by hand at t = {at:g} s: "
            "give a recording without that"
        )
    states, commands = run.table(topics.JOINT_STATES), run.table(topics.EFFORT_COMMAND)
    joint = states.index(e.config.joint)
    hip = None if e.config.hip is None else states.index(e.config.hip)
    place = commands.index(e.config.joint)
    given = commands.values("effort")[:, place]
    position, velocity = states.values("position"), states.values("velocity")
    effort = states.values("effort")
    times = e.config.active_times_ns
    reference: float | None = None
    rows = []
    for k, stamp_ns in enumerate(states.stamp_ns.tolist()):
        reference = plan.references.get(stamp_ns, reference)
        motion = Hip() if hip is None else Hip(float(position[k, hip]), float(velocity[k, hip]))
        row = commands.row(stamp_ns)
        answered = row is not None and active_at(times, stamp_ns)
        reading = Reading(
            stamp_ns,
            float(position[k, joint]),
            float(velocity[k, joint]),
            motion,
            float(effort[k, joint]),
            reference is not None,
            reference or 0.0,
        )
        rows.append(ExportedStep(reading, float(given[row]) if answered else 0.0, answered))
    return rows


def _check_parameters(run: RecordedRun, e: ExportedController) -> None:
    mine, theirs = values_of(e.config), values_of(run.config(e.law.name))
    for name, value in mine.items():
        acts = name not in ("autostart", "lockstep.enabled")
        if acts and repr(theirs.get(name)) != repr(value):
            raise PlanError(
                f"--like {run.path}: {e.law.name} ran with {name} = {theirs.get(name)}, not {value}: leave "
                "out --params and --set, or record a run with them"
            )


def swinging_rows(e: ExportedController, count: int = SWINGING) -> list[ExportedStep]:
    """Return CPython's answers to so many states, where there is no recording."""
    return e.answers(count)


def packed(rows: Sequence[ExportedStep]) -> bytes:
    """Return rows as replay.c reads them: 64 bits a number, little-endian."""
    chunks = [pack("<qdddddqddq", *row.numbers, row.compared) for row in rows]
    return b"".join([pack("<qq", MAGIC, len(rows)), *chunks])


def bare_rows(e: ExportedController, rows: Sequence[ExportedStep]) -> list[ExportedStep]:
    """Return CPython's answers of the bare law to the same states, each a period after the one before."""
    readings = [row.reading for row in rows if _finite(row.reading)]
    return e.answered(readings)


def _finite(r: Reading) -> bool:
    return isfinite(r.position) and isfinite(r.velocity) and r.stamp_ns < 2**31 * NANOSECONDS
