"""An episode as a recording: its plan is run again with its actions, like any offline run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from trunk_control.controller import Controller
from trunk_control.law import Constants, Law, Sample
from trunk_control.limits import Limits, limited
from trunk_control.pid import LAW, pid_update
from trunk_control.pid_family import Gains, PidState, Terms
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_sim.simulation import DivergedError

from ..runs.engine import Engine, start_of
from ..runs.offline_recording import record_states
from .task import Drawn, Task

POLICY = "policy"  # the controller's name in the recording


class TorqueTerms(NamedTuple):
    """What is recorded for a policy that gives torques; for one that gives gains, the PID's terms are."""

    error: float  # rad
    unsaturated: float  # N m, the action
    effort: float  # N m, within the controller's limits
    held: bool


class PolicyMemory(NamedTuple):
    """How many actions were taken, and the PID that they tune."""

    effort: float  # N m
    taken: int
    pid: PidState


def policy_law(actions: Sequence[Floats], by_gains: bool) -> Law:
    """Return the law that takes one action after the other; no action answers the last state."""

    def torque(
        memory: PolicyMemory, sample: Sample, constants: Constants, limits: Limits
    ) -> tuple[PolicyMemory, TorqueTerms]:
        error = sample.reference - sample.measurement
        if memory.taken == len(actions):
            return memory, TorqueTerms(error, memory.effort, memory.effort, True)
        given = float(actions[memory.taken][0])
        after = PolicyMemory(limited(given, limits), memory.taken + 1, memory.pid)
        return after, TorqueTerms(error, given, after.effort, False)

    def gains(
        memory: PolicyMemory, sample: Sample, constants: Constants, limits: Limits
    ) -> tuple[PolicyMemory, Terms]:
        if memory.taken == len(actions):
            return memory, LAW.no_terms._replace(effort=memory.effort, held=True)
        given = Gains(*map(float, actions[memory.taken]))
        pid, terms = pid_update(memory.pid, *sample[:4], given, limits)
        return PolicyMemory(terms.effort, memory.taken + 1, pid), terms._replace(held=False)

    return Law(
        POLICY,
        POLICY,
        LAW.config,
        gains if by_gains else torque,
        PolicyMemory(0.0, 0, LAW.memory),
        LAW.terms if by_gains else TorqueTerms,
    )


def save_episode(
    task: Task,
    drawn: Drawn,
    actions: Sequence[Floats],
    states: int | None,
    path: Path,
    overwrite: bool,
) -> Path:
    """Write an episode; ``states``: how many it has, if it has not ended.

    An episode whose plant diverged is marked as incomplete. Raises OSError.
    """
    plan, config = task.plan_of(drawn, states), task.plan.controller
    run = replace(plan, controllers={POLICY: config})
    law = policy_law(actions, task.by_gains)
    start = start_of(plan)._replace(controllers={POLICY: Controller(config, law)})
    with suppress(DivergedError):  # as in the environment: the file says so
        stretches = Engine(run, start, compiled=False).states()
        record_states(plan, stretches, path, (POLICY,), overwrite)
    return path
