"""Compares runs in CPython, in compiled code and in lanes, bit by bit."""

from __future__ import annotations

import numpy as np

from trunk_control.laws import law_named
from trunk_msgs_util.units import NANOSECONDS
from trunk_sim.simulation import DivergedError
from trunk_sim.step import torque_of
from trunk_sim.traffic import Traffic

from ..errors import PlanError
from ..plans.plan import RunPlan
from ..runs.steps import Step, steps
from .block import regular_run, run_block, summary_of
from .columns import LANES
from .compiled_run import Batch, Outcome, gains_of
from .lanes import TRACED


def first_difference(plan: RunPlan, batch: Batch) -> str | None:
    """Return the first difference of a plan's compiled and interpreted runs; None if all bits are equal.

    A plan that both refuse with the same message counts as equal.
    """
    try:
        outcome = batch.run(plan)
    except PlanError as error:
        return _refusal_difference(plan, str(error))
    taken: list[Step] = []
    diverged = False
    try:
        taken.extend(steps(plan))
    except DivergedError:
        diverged = True
    if len(taken) != len(outcome.table.t) or diverged != (outcome.diverged_at is not None):
        return (
            f"{plan.scenario}: {len(outcome.table.t)} finite states compiled, "
            f"{len(taken)} interpreted"
        )
    return _table_difference(plan, outcome, taken) or lane_difference(plan, outcome)


def lane_difference(plan: RunPlan, outcome: Outcome) -> str | None:
    """Return the first difference of a lane and a run of its own; None if all bits are equal.

    Nothing is compared if the run is not regular, or leaves the regular course.
    """
    regular = regular_run(plan)
    if regular is None:
        return None
    trace = np.empty((regular.common.states, TRACED, LANES))
    in_lane = run_block(plan.controller_name, [regular] * LANES, trace)[0]
    if in_lane is None:
        return None
    t = outcome.table
    names = ("x", "theta", "x_dot", "theta_dot", "reference", "torque")
    if len(trace) != len(t.t):
        return f"{plan.scenario}: {len(trace)} states in a lane, {len(t.t)} alone"
    for i, name in enumerate(names):
        alone = getattr(t, name).view(np.int64)
        for lane in (0, LANES - 1):
            wrong = np.flatnonzero(np.ascontiguousarray(trace[:, i, lane]).view(np.int64) != alone)
            if len(wrong):
                k = int(wrong[0])
                return (
                    f"{plan.scenario}: step {k}: {name} is {float(trace[k, i, lane])!r} in lane {lane}, "
                    f"{float(getattr(t, name)[k])!r} alone"
                )
    alone_too = summary_of(plan, Batch())
    return (
        None if in_lane == alone_too else f"{plan.scenario}: {in_lane} in a lane, {alone_too} alone"
    )


def _refusal_difference(plan: RunPlan, reason: str) -> str | None:
    try:
        next(steps(plan))
    except PlanError as error:
        if str(error) == reason:
            return None
        reason = f"{reason!r} compiled, {str(error)!r}"
    return f"{plan.scenario}: refused: {reason} interpreted"


def _table_difference(plan: RunPlan, outcome: Outcome, taken: list[Step]) -> str | None:
    table, plant = outcome.table, plan.simulator.plant
    held = [float("nan")] * 5
    columns: list[list[float]] = []
    network = plan.simulator.network
    traffic = None if network is None else Traffic(network)
    sent: list[float] = []
    for step in taken:
        answer = step.answer
        if answer is None:
            return f"{plan.scenario}: nobody answers at t = {step.stamp_ns / NANOSECONDS:g} s"
        terms = answer.terms
        if answer.updated:
            held = [answer.reference, *gains_of(law_named(step.controller))(terms)]
        sent.append(answer.effort)
        used = len(sent) - 1 if traffic is None else traffic.command_step(len(sent) - 1)
        torque = torque_of(step.truth.effort[1], sent[used] if used >= 0 else 0.0, plant)
        columns.append(
            [
                step.stamp_ns / NANOSECONDS,
                *step.truth.position,
                *step.truth.velocity,
                step.measured.position[1],
                held[0],
                torque,
                *held[1:],
            ]
        )
    expected = np.array(columns).T
    actual = np.array([getattr(table, name) for name in table.__dataclass_fields__])
    wrong = np.argwhere(expected.view(np.int64) != actual.view(np.int64))
    if not len(wrong):
        return None
    step_index = int(wrong[:, 1].min())
    row = int(wrong[wrong[:, 1] == step_index][0, 0])
    name = list(table.__dataclass_fields__)[row]
    return (
        f"{plan.scenario}: step {step_index}: {name} is {float(actual[row, step_index])!r} compiled, "
        f"{float(expected[row, step_index])!r} interpreted"
    )
