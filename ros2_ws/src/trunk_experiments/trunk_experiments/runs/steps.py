"""A run's states one by one, and the table of states that others have made."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from trunk_control.decide import Output, state_record
from trunk_control.law import names_of_record
from trunk_control.laws import law_named
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.samples import JointSample
from trunk_sim.disturbances import Disturbance
from trunk_sim.simulation import DivergedError

from ..plans.plan import RunPlan
from .engine import states_of_run
from .states import (
    ACTING,
    APPLIED,
    EFFORT,
    FRESH,
    OFFSET,
    POSITION,
    REFERENCE,
    SEEN_APPLIED,
    SEEN_POSITION,
    SEEN_VELOCITY,
    TERMS,
    VELOCITY,
    States,
)


class Step(NamedTuple):
    """All messages of one stamp."""

    stamp_ns: int
    truth: JointSample
    measured: JointSample
    acting: Disturbance
    controller: str  # the controller that answers; empty: none
    answer: Output | None
    turned: tuple[
        tuple[str, bool], ...
    ]  # made active or inactive by the schedule, before the answer
    falls: bool  # the trunk fell in this state


def steps(plan: RunPlan) -> Iterator[Step]:
    """Yield a run's states one by one, as CPython computes them. Raises as `states_of_run` does."""
    laws = {name: law_named(name) for name in plan.controllers}
    joints, period_ns = plan.simulator.joints, plan.simulator.period_ns
    for states in states_of_run(plan, compiled=False):
        for row, values in enumerate(states.table.tolist()):
            stamp_ns, name = (states.first + row) * period_ns, states.acting(row)
            answer = None
            if name:
                terms = laws[name].no_terms
                if values[FRESH]:
                    terms = laws[name].terms(*values[TERMS + 2 :][: len(terms) - 1], False)
                answer = Output(
                    True, values[EFFORT], bool(values[FRESH]), False, values[REFERENCE], terms
                )
            truth, measured = (
                JointSample(
                    stamp_ns, joints, tuple(values[p]), tuple(values[v]), (0.0, values[torque])
                )
                for p, v, torque in (
                    (POSITION, VELOCITY, APPLIED),
                    (SEEN_POSITION, SEEN_VELOCITY, SEEN_APPLIED),
                )
            )
            acting = Disturbance(*values[ACTING], *values[OFFSET])
            turned = tuple((who, on) for at, who, on in states.turned if at == row)
            yield Step(stamp_ns, truth, measured, acting, name, answer, turned, row in states.falls)


def in_stretches(steps: Iterable[Step], states: int, first: int = 0) -> Iterator[States]:
    """Yield steps that CPython computes, in stretches of states; ``first`` is the first one's index.

    Raises what ``steps`` raises; where that is DivergedError, what was done before it is yielded first.
    """
    rows: list[tuple[float, ...]] = []
    irregular = _Irregular([], [], [], {})
    try:
        for step in steps:
            rows.append(_row(step))
            irregular.take(len(rows) - 1, step)
            if len(rows) == states:
                yield States(first, _table(rows), *irregular)
                first += len(rows)
                rows, irregular = [], _Irregular([], [], [], {})
    except DivergedError:
        if rows:
            yield States(first, _table(rows), *irregular)
        raise
    if rows:
        yield States(first, _table(rows), *irregular)


class _Irregular(NamedTuple):
    acts: list[tuple[int, str]]
    turned: list[tuple[int, str, bool]]
    falls: list[int]
    term_names: dict[str, tuple[str, ...]]

    def take(self, row: int, step: Step) -> None:
        if not self.acts or self.acts[-1][1] != step.controller:
            self.acts.append((row, step.controller))
        self.turned.extend((row, name, active) for name, active in step.turned)
        if step.falls:
            self.falls.append(row)
        if step.answer is not None and step.controller not in self.term_names:
            self.term_names[step.controller] = names_of_record(step.answer.terms)


def _table(rows: list[tuple[float, ...]]) -> Floats:
    width = max(map(len, rows))
    return np.array([row + (0.0,) * (width - len(row)) for row in rows])


def _row(step: Step) -> tuple[float, ...]:
    truth, measured, answer = step.truth, step.measured, step.answer
    measured_torque = measured.effort[1]
    answered: tuple[float, ...] = (0.0, 0.0, 0.0, measured_torque, 0.0, 0.0)
    if answer is not None:
        said = state_record(answer, measured.position[1]) if answer.updated else ()
        answered = (
            answer.effort,
            float(answer.updated),
            answer.reference,
            measured_torque,
            1.0,
            0.0,
            *said,
        )
    return (
        *truth.position,
        *truth.velocity,
        *measured.position,
        *measured.velocity,
        truth.effort[1],
        *step.acting,
        *answered,
    )
