"""The evidence for a command of a foreign controller: not its law, but the inputs of the plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.source import ARRIVAL
from trunk_msgs_util.units import nanoseconds, seconds
from trunk_sim.disturbances import Disturbance

from ..analysis.run_table import RunTable
from ..recorded.inputs import RecordedInputs
from ..recorded.run import RecordedRun
from ..results import OMITTED, As, Known, known
from .doubts import RecordingResult, about


def _known(terms: Mapping[str, float]) -> dict[str, float | None]:
    return {name: known(value) for name, value in terms.items()}


_TERMS = As(Mapping[str, float | None], _known)


@dataclass(frozen=True)
class ExternalCommand(RecordingResult, document="explain-external-1"):
    """The document of ``trunk explain``, of somebody else's controller: a command, and what it answers.

    SI units and radians; NaN: not on record.
    """

    asked_s: float
    controller: Annotated[str, "What the run goes by"]
    command: Annotated[float | None, "N m; null: none was in force"]
    answers_s: Annotated[float | None, "The state that it answers; null: it acts from its arrival"]
    arrived: Annotated[bool, OMITTED]  # True: its stamp is no state's
    reference: Annotated[Known, "rad"]
    measurement: Annotated[Known, "rad"]
    true_angle: Annotated[Known, "rad"]
    disturbance: Annotated[Disturbance, "N, N m, m, rad"]
    applied: Annotated[Known, "N m, to the plant over the step that begins then"]
    terms: Annotated[Mapping[str, float], _TERMS, "By the node's own names; empty: none"]


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
        **vars(about(run)),
        asked_s=at,
        controller=run.external,
        command=float(force.command[0]) if command_ns >= 0 else None,
        answers_s=None if arrived or command_ns < 0 else seconds(command_ns),
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
