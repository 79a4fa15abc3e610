"""An episode as a recording: its plan is run again with its actions, like any offline run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from trunk_control.decide import Output
from trunk_control.law import LawTerms
from trunk_control.limits import limited
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState
from trunk_control.reference import reference_at
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import step_count
from trunk_sim.simulation import DivergedError, Simulation

from ..plans.plan import RunPlan
from ..runs.offline import disturbance_source
from ..runs.offline_recording import record_steps
from ..runs.steps import Step
from .task import Drawn, Task

POLICY = "policy"  # the controller's name in the recording


class TorqueTerms(NamedTuple):
    """What is recorded for a policy that gives torques; for one that gives gains, the PID's terms are."""

    error: float  # rad
    unsaturated: float  # N m, the action
    effort: float  # N m, within the controller's limits
    held: bool


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
    plan = task.plan_of(drawn, states)
    with suppress(DivergedError):  # as in the environment: the file says so
        record_steps(plan, policy_steps(task, plan, actions), path, (POLICY,), overwrite)
    return path


def policy_steps(task: Task, plan: RunPlan, actions: Sequence[Floats]) -> Iterator[Step]:
    """Yield the steps of an episode of a plan under these actions.

    The last state's command repeats the one before: no action answers that state.
    Raises DivergedError where the plant diverged.
    """
    simulation = Simulation(plan.simulator)
    disturbances = disturbance_source(plan)
    last = step_count(plan.simulator.duration, plan.simulator.update_rate)
    every = task.regular.common.update_every
    policy = _Policy(task)
    answer = Output(True, 0.0, False, False, 0.0, TorqueTerms(0.0, 0.0, 0.0, False))
    while True:
        k, stamp_ns = simulation.step_index, simulation.stamp_ns
        acting = disturbances(stamp_ns)
        measured = simulation.measure(acting)
        if k % every == 0 and k // every < len(actions):
            answer = policy.answer(measured, actions[k // every])
        else:
            answer = answer._replace(updated=False)
        truth, falls = simulation.truth(), simulation.falls_now
        yield Step(stamp_ns, truth, measured, acting, POLICY, answer, (), falls)
        if simulation.ended_by_fall or k == last:
            return
        simulation.step(answer.effort, acting)


class _Policy:
    """Turns an action into an answer, in CPython, with the same functions as `kernel.command`."""

    def __init__(self, task: Task) -> None:
        self._task = task
        common = task.regular.common
        self._limits = common.limits
        self._state = PidState(effort=task.regular.effort)
        self._dt, self._later = common.first_dt, common.dt

    def answer(self, measured: JointSample, action: Floats) -> Output:
        """Return the answer to a measured state."""
        reference = reference_at(measured.stamp_ns, self._task.regular.profile)
        angle, rate = measured.position[1], measured.velocity[1]
        given = [float(number) for number in action]
        terms: LawTerms
        if self._task.by_gains:
            self._state, terms = pid_update(
                self._state, reference, angle, rate, self._dt, Gains(*given), self._limits
            )
        else:
            effort = limited(given[0], self._limits)
            terms = TorqueTerms(reference - angle, given[0], effort, False)
        self._dt = self._later
        return Output(True, terms.effort, True, False, reference, terms)
