"""Compares runs in CPython, in compiled code and in lanes, bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from trunk_msgs_util.recording.joint_table import Floats
from trunk_sim.simulation import DivergedError

from ..analysis.run_table import RunTable
from ..errors import PlanError
from ..plans.plan import RunPlan
from ..recorded.run import RecordedRun
from ..runs.engine import states_of_run
from ..runs.offline_recording import record_states
from .block import RunSummary, regular_run, run_block, summary_of
from .compiled_run import Batch, Outcome
from .lanes import LANES, TRACED

_IN_LANES = ("x", "theta", "x_dot", "theta_dot", "reference", "torque")


def first_difference(plan: RunPlan, batch: Batch) -> str | None:
    """Return the first difference of a plan's compiled and interpreted runs; None if all bits are equal.

    A plan that both refuse with the same message counts as equal.
    """
    try:
        outcome = batch.run(plan)
    except PlanError as error:
        return _refusal_difference(plan, str(error))
    diverged = False
    with TemporaryDirectory(prefix="trunk-check-") as folder:
        path = Path(folder) / "run.mcap"
        try:
            record_states(plan, states_of_run(plan, compiled=False), path, tuple(plan.controllers))
        except DivergedError:
            diverged = True
        expected = RunTable.of_run(RecordedRun.open(path))
    if diverged != (outcome.diverged_at is not None):
        return f"{plan.scenario}: diverged: {not diverged} compiled, {diverged} interpreted"
    return column_difference(expected, vars(outcome.table)) or lane_difference(plan, outcome)


def column_difference(expected: RunTable, columns: Mapping[str, Floats]) -> str | None:
    """Return the first difference of some columns from those expected; None if all bits are equal."""
    firsts: list[tuple[int, str]] = []
    for name, column in columns.items():
        wanted = getattr(expected, name)
        if len(column) != len(wanted):
            return f"{len(column)} states, {len(wanted)} expected"
        # Bits of NaN have no meaning.
        wrong = (column.view(np.int64) != wanted.view(np.int64)) & ~(
            np.isnan(column) & np.isnan(wanted)
        )
        firsts += [(int(k), name) for k in np.flatnonzero(wrong)[:1]]
    if not firsts:
        return None
    k, name = min(firsts, key=lambda first: first[0])
    values = (float(columns[name][k]), float(getattr(expected, name)[k]))
    return f"step {k}: {name} is {values[0]!r}, {values[1]!r} expected"


def lane_difference(plan: RunPlan, outcome: Outcome) -> str | None:
    """Return the first difference of a lane and a run of its own; None if all bits are equal.

    Nothing is compared if the run is not regular, or leaves the regular course.
    """
    in_lanes = lane_columns(plan)
    if in_lanes is None:
        return None
    summary, lanes = in_lanes
    for columns in lanes:
        if difference := column_difference(outcome.table, columns):
            return f"{plan.scenario}: in a lane: {difference}"
    alone = summary_of(plan, Batch())
    return None if summary == alone else f"{plan.scenario}: {summary} in a lane, {alone} alone"


def lane_columns(plan: RunPlan) -> tuple[RunSummary, list[dict[str, Floats]]] | None:
    """Return the outcome of a run in lanes, and columns of the first lane and the last.

    None if the run is not regular, or leaves the regular course.
    """
    regular = regular_run(plan)
    if regular is None:
        return None
    trace = np.empty((regular.common.states, TRACED, LANES))
    summary = run_block(plan.controller_name, [regular] * LANES, trace)[0]
    if summary is None:
        return None
    return summary, [
        {name: trace[:, row, lane].copy() for row, name in enumerate(_IN_LANES)}
        for lane in (0, LANES - 1)
    ]


def _refusal_difference(plan: RunPlan, reason: str) -> str | None:
    try:
        next(states_of_run(plan, compiled=False))
    except PlanError as error:
        if str(error) == reason:
            return None
        reason = f"{reason!r} compiled, {str(error)!r}"
    return f"{plan.scenario}: refused: {reason} interpreted"
