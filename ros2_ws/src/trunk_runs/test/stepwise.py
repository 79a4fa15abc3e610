"""A run's states one by one."""

from collections.abc import Iterator
from typing import NamedTuple

from trunk_control.decide import Output
from trunk_control.laws import law_named
from trunk_core.samples import JointSample
from trunk_runs.engine import (
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
    states_of_run,
)
from trunk_runs.plan import RunPlan
from trunk_sim.disturbances import Disturbance


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
