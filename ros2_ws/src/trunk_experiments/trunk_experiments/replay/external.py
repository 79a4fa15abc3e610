"""The evidence for a command of a foreign controller: not its law, but the inputs of the plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.source import ARRIVAL
from trunk_msgs_util.units import nanoseconds, seconds
from trunk_sim.disturbances import Disturbance

from ..analysis.run_table import RunTable
from ..recorded.inputs import RecordedInputs
from ..recorded.run import RecordedRun


@dataclass(frozen=True)
class ExternalCommand:
    """The command in force at a time, and what it answers. SI units and radians; NaN: not on record."""

    asked: float  # s
    controller: str
    command: float | None  # N m; None: none was in force
    answers: float | None  # s, the state that it answers; None: it acts from its arrival
    arrived: bool  # True: its stamp is no state's
    reference: float
    measurement: float
    true_angle: float
    disturbance: Disturbance
    applied: float  # N m, to the plant over the step that begins then
    terms: Mapping[str, float]  # that the node published itself, by its own names


def external_command(run: RecordedRun, at: float) -> ExternalCommand:
    """Return the command in force at a time in s, with its context. Raises RecordingError outside the run."""
    table = RunTable.from_run(run)
    if not table.t[0] <= at <= table.t[-1]:
        raise RecordingError(
            f"{run.path} lasts from t = {table.t[0]:g} s to t = {table.t[-1]:g} s: "
            f"give --at a time in it, not {at:g}"
        )
    row = max(0, int((table.t <= at).sum()) - 1)
    stamp_ns = run.begin_ns + nanoseconds(float(table.t[row]))
    inputs = RecordedInputs(run, np.array([stamp_ns]))
    force = inputs.over(slice(None))
    command_ns = int(force.command_ns[0])
    arrived = inputs.sources[int(force.command_source[0])] == ARRIVAL
    return ExternalCommand(
        asked=at,
        controller=run.external,
        command=float(force.command[0]) if command_ns >= 0 else None,
        answers=None if arrived or command_ns < 0 else seconds(command_ns),
        arrived=arrived,
        reference=float(table.reference[row]),
        measurement=float(table.theta_measured[row]),
        true_angle=float(table.theta[row]),
        disturbance=Disturbance(*force.disturbance[0].tolist()),
        applied=float(table.torque[row]),
        terms=_terms(run, command_ns),
    )


def _terms(run: RecordedRun, stamp_ns: int) -> dict[str, float]:
    """Return the terms that somebody else's node has published for a state."""
    for name in run.controllers:
        table = run.table(topics.controller_state(name))
        if name not in run.parameters and stamp_ns in table:
            return dict(zip(table.names, table.get(stamp_ns, "position"), strict=True))
    return {}
