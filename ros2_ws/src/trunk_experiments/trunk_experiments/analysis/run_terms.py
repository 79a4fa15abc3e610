"""What `RunTable` leaves out: the controller's terms and the disturbance, one row per true state."""

from __future__ import annotations

import numpy as np

from trunk_control.laws import law_named
from trunk_msgs_util import topics
from trunk_msgs_util.recording.columns import in_turn, series_of
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.units import NANOSECONDS

from ..plans.nodes import CONTROLLERS
from ..recorded.run import RecordedRun
from .run_table import COLUMNS, TABLE_UNITS, RunTable, held_at, matched_at

DISTURBANCE = {
    "disturbance_hip_effort": "N",
    "disturbance_trunk_effort": "N m",
    "disturbance_hip_position": "m",
    "disturbance_trunk_position": "rad",
}
COMMAND = "command"  # a law's term `effort`, which is a metric's name too
# The units of the terms of PID and its kind.
UNITS = {
    "error": "rad",
    "error_rate": "rad/s",
    **dict.fromkeys(("p_term", "i_term", "d_term", "unsaturated", COMMAND), "N m"),
}


def terms(run: RecordedRun, table: RunTable) -> dict[str, Floats]:
    """Return the terms that the controllers recorded, by name, of the last update at each state.

    Gains and reference are columns of the table. NaN before the first update, and where the controller that
    acted has no such term.
    """
    states = [topics.controller_state(name) for name in run.controllers]
    states = [state for state in states if run.count(state)]
    recorded = dict.fromkeys(name for state in states for name in run.joint_names(state))
    names = [name for name in recorded if name not in (*COLUMNS, "measurement")]
    if not names:
        return {}
    columns = [("position", name) for name in names]
    merged = in_turn([series_of(run.joints(state), columns) for state in states])
    at = _stamps(run, table)
    return {
        COMMAND if name == "effort" else name: held_at(
            at, merged.stamp_ns, merged.column("position", name)
        )
        for name in names
    }


def disturbance(run: RecordedRun, table: RunTable) -> dict[str, Floats]:
    """Return the disturbances of hip and trunk at each state: forces, and offsets on the measurement."""
    at = _stamps(run, table)
    if not run.count(topics.DISTURBANCE):
        return {name: np.zeros(len(at)) for name in DISTURBANCE}
    acting = run.joints(topics.DISTURBANCE).by_stamp()
    joints = (*acting.names, "", "")[:2]  # of one that is missing nothing is known
    columns = [(kind, joint) for kind in ("effort", "position") for joint in joints]
    return {
        name: matched_at(at, acting.stamp_ns, acting.column(*column))
        for name, column in zip(DISTURBANCE, columns, strict=True)
    }


def all_columns(run: RecordedRun, table: RunTable) -> dict[str, Floats]:
    """Return the table's columns, then terms and disturbance."""
    own = {name: getattr(table, name) for name in COLUMNS}
    return {**own, **terms(run, table), **disturbance(run, table)}


def column_units(run: RecordedRun) -> dict[str, str]:
    """Return the units of `all_columns` by name: empty for a ratio, none for a term of an unknown law."""
    known = [law_named(name).units for name in run.controllers if name in CONTROLLERS]
    own = {name: unit for units in known for name, unit in units.items()}
    return {**own, **TABLE_UNITS, **UNITS, **DISTURBANCE}


def _stamps(run: RecordedRun, table: RunTable) -> Integers:
    return np.rint(table.t * NANOSECONDS).astype(np.int64) + run.begin_ns
