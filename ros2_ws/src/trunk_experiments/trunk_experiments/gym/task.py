"""What defines an environment's episodes, and an episode as a recording: a run again with its actions."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import copysign, isfinite, pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trunk_control.controller import Controller
from trunk_control.law import Constants, Law, LawMemory, LawTerms, Limits, Sample, limited
from trunk_control.laws import law_of
from trunk_core.arrays import Floats
from trunk_core.errors import PlanError, did_you_mean
from trunk_core.parameters.declarations import build, values_of
from trunk_core.units import seconds
from trunk_runs.engine import Engine
from trunk_runs.loop import check
from trunk_runs.offline_recording import record_states
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.scenario import parse_setting
from trunk_sim.config import SimulatorConfig
from trunk_sim.simulation import DivergedError
from trunk_studies.batch.block import LONGEST, Regular, regular_run
from trunk_studies.batch.lanes import made_of, numbers_in, without_row

ACTIONS = ("torque", "gains")
SPREAD = (0.0, 0.1, 0.0, 0.1)  # m, rad, m/s, rad/s
EFFORT_WEIGHT = 1e-5  # rad^2 / (N m)^2
# By default. Its section of the parameters gives the reference, the rate, the limits and the law's modes.
CONTROLLER = "pid"


class Drawn(NamedTuple):
    """What is drawn for an episode."""

    initial: tuple[float, ...]  # m, rad, m/s, rad/s
    sensor_seed: int
    disturbance_seed: int  # of its noise
    pulse_seed: int  # of its random pulses


@dataclass(frozen=True)
class Task:
    """What all episodes of an environment have in common."""

    plan: RunPlan
    regular: Regular  # the plan as a lane runs it
    constants: Constants | None  # of the law, whose place actions take; None: actions are torques
    low: Floats  # of an action
    high: Floats
    spread: tuple[float, ...]  # of the initial state: m, rad, m/s, rad/s
    effort_weight: float  # rad^2 / (N m)^2

    @property
    def as_planned(self) -> Drawn:
        """The plan's own initial state and seeds."""
        plan = self.plan
        disturbance = plan.disturbance
        seeds = (
            (0, 0)
            if disturbance is None
            else (disturbance.noise_seed, disturbance.pulse_random_seed)
        )
        return Drawn(tuple(plan.simulator.initial_state), plan.simulator.seed, *seeds)

    @property
    def draws_disturbances(self) -> bool:
        """True if the disturbance has noise or random pulses, whose seed is drawn for each episode."""
        disturbance = self.plan.disturbance
        return disturbance is not None and bool(
            disturbance.noise_rms or disturbance.pulse_random_count
        )

    def draw(self, generator: np.random.Generator) -> Drawn:
        """Return an episode's initial state ``plan + spread (2 u - 1)``, u uniform in [0, 1), and seeds.

        From raw 64-bit integers, whose stream NumPy guarantees: the same bits on every machine.
        """
        raw: list[int] = [int(word) for word in generator.bit_generator.random_raw(6)]
        initial = tuple(
            middle + width * (2.0 * ((word >> 11) * 2.0**-53) - 1.0)
            for middle, width, word in zip(self.as_planned.initial, self.spread, raw, strict=False)
        )
        return Drawn(initial, raw[4] >> 33, raw[5] >> 33, raw[5] >> 33)

    def plan_of(self, drawn: Drawn, states: int | None = None) -> RunPlan:
        """Return the plan of an episode, shortened to ``states`` if given, without any of our controllers."""
        plan, (x, theta, x_dot, theta_dot) = self.plan, drawn.initial
        disturbance = plan.disturbance
        if disturbance is not None and self.draws_disturbances:
            disturbance = replace(
                disturbance,
                noise_seed=drawn.disturbance_seed,
                pulse_random_seed=drawn.pulse_seed,
            )
        duration = plan.simulator.duration
        if states is not None:
            duration = seconds((states - 1) * plan.simulator.period_ns)
        simulator = replace(
            plan.simulator,
            initial_position=(x, theta),
            initial_velocity=(x_dot, theta_dot),
            seed=drawn.sensor_seed,
            duration=duration,
        )
        return replace(plan, simulator=simulator, disturbance=disturbance, controllers={})


def make_task(
    scenario: str | Path = "demo",
    *,
    params: Sequence[str | Path] = (),
    settings: Sequence[str] = (),
    controller: str = CONTROLLER,
    duration: float | None = None,
    rate: float | None = None,
    action: str = "torque",
    largest_gains: Sequence[float] | None = None,
    spread: Sequence[float] = SPREAD,
    effort_weight: float = EFFORT_WEIGHT,
) -> Task:
    """Return the task that an environment's options describe.

    ``scenario``, ``params``, ``settings`` (NODE.PARAM=VALUE), ``controller``, ``duration`` [s] and ``rate``
    [Hz] as in ``trunk simulate``. ``action``: "torque", or "gains": the constants of the controller's law,
    kp, ki, kd of ``pid``; ``largest_gains``: by default twice the controller's own. ``spread``: half-widths
    of the draws around the plan's initial x [m], angle [rad] and their rates. A fall ends an episode unless
    simulator.fall.stop is set to false. Raises PlanError, ParameterFileError or ParameterError.
    """
    if action not in ACTIONS:
        raise PlanError(
            f"action {action!r}: give one of {', '.join(ACTIONS)}{did_you_mean(str(action), ACTIONS)}"
        )
    everywhere: dict[str, object] = {"fall.stop": True}
    everywhere |= {} if duration is None else {"duration": duration}
    everywhere |= {} if rate is None else {"update_rate": rate}
    plan = make_plan(
        str(scenario),
        controller,
        _texts("params", params),
        [parse_setting(text, "settings") for text in _texts("settings", settings)],
        everywhere,
    )
    check(plan)
    if plan.simulator.network is not None:
        raise PlanError(
            "link.state, link.command, sensor.dropout: an episode has no links: leave them out"
        )
    if strange := without_row(law_of(plan.controller).memory):
        raise PlanError(f"{controller}: its {strange}, not a number: it has no environment")
    regular = regular_run(plan)
    if regular is None:
        raise PlanError(
            f"duration {plan.simulator.duration:g} s, active.times {list(plan.controller.active_times)}: "
            f"an episode has at most {LONGEST} states, and no turns"
        )
    widths = _numbers("spread", spread, 4)
    _check_spread(plan.simulator, widths)
    (weight,) = _numbers("effort_weight", [effort_weight], 1)
    low, high = _bounds(plan, action, largest_gains)
    constants = plan.controller.constants if action == "gains" else None
    return Task(plan, regular, constants, low, high, widths, weight)


def lost(task: Task) -> float:
    """Return the squared error [rad^2] that is charged for the rest of an episode that ended early."""
    return float(min(task.plan.simulator.fall_angle, pi) ** 2)


def _check_spread(simulator: SimulatorConfig, widths: tuple[float, ...]) -> None:
    """Raise PlanError or ParameterError for initial states from which no episode can begin."""
    x, theta, x_dot, theta_dot = (
        middle + copysign(width, middle)
        for middle, width in zip(simulator.initial_state, widths, strict=True)
    )
    farthest = {"initial.position": (x, theta), "initial.velocity": (x_dot, theta_dot)}
    build(type(simulator), {**values_of(simulator), **farthest})
    if simulator.fall_stop and abs(theta) > simulator.fall_angle:
        raise PlanError(
            f"spread {list(widths)}: the initial angle is up to {abs(theta):g} rad, beyond fall.angle "
            f"({simulator.fall_angle:g}): the trunk would have fallen before the episode begins; give less"
        )


def _bounds(
    plan: RunPlan, action: str, largest_gains: Sequence[float] | None
) -> tuple[Floats, Floats]:
    config = plan.controller
    if action == "gains":
        own = numbers_in(config.constants)
        if not all(type(number) is float for number in own):
            raise PlanError(
                f"action 'gains': the constants of {plan.controller_name} are not all floats: give 'torque'"
            )
        ends = np.array(
            [2.0 * gain for gain in own]
            if largest_gains is None
            else _numbers("largest_gains", largest_gains, len(own))
        )
        return np.minimum(ends, 0.0), np.maximum(ends, 0.0)
    if largest_gains is not None:
        raise PlanError("largest_gains: it is for action='gains' only; leave it out")
    limit = plan.simulator.max_effort
    return (
        np.array([max(-limit, config.u_clamp_min)]),
        np.array([min(limit, config.u_clamp_max)]),
    )


def _texts(name: str, values: Sequence[str | Path]) -> Sequence[str]:
    if isinstance(values, str):
        raise PlanError(f"{name} {values!r}: give a list, such as [{values!r}]")
    return [str(value) for value in values]


def _numbers(name: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    """Return ``count`` finite numbers of at least 0. Raises PlanError for anything else."""
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != count or not all(isfinite(number) and number >= 0.0 for number in numbers):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise PlanError(f"{name} {values!r}: give {wanted}, 0 or greater")
    return numbers


POLICY = "policy"  # the controller's name in the recording


class TorqueTerms(NamedTuple):
    """What is recorded for a policy that gives torques; for one that gives gains, the PID's terms are."""

    error: float  # rad
    unsaturated: float  # N m, the action
    effort: float  # N m, within the controller's limits
    held: bool


class PolicyMemory(NamedTuple):
    """How many actions were taken, and what the law remembers that they tune."""

    effort: float  # N m
    taken: int
    tuned: LawMemory


def policy_law(actions: Sequence[Floats], tuned: Law, by_gains: bool) -> Law:
    """Return the law that takes one action after the other; no action answers the last state."""

    def torque(
        memory: PolicyMemory, sample: Sample, constants: Constants, limits: Limits
    ) -> tuple[PolicyMemory, TorqueTerms]:
        error = sample.reference - sample.measurement
        if memory.taken == len(actions):
            return memory, TorqueTerms(error, memory.effort, memory.effort, True)
        given = float(actions[memory.taken][0])
        after = PolicyMemory(limited(given, limits), memory.taken + 1, memory.tuned)
        return after, TorqueTerms(error, given, after.effort, False)

    def gains(
        memory: PolicyMemory, sample: Sample, constants: Constants, limits: Limits
    ) -> tuple[PolicyMemory, LawTerms]:
        if memory.taken == len(actions):
            return memory, tuned.no_terms._replace(effort=memory.effort, held=True)
        given = made_of(constants, map(float, actions[memory.taken]))
        after, terms = tuned.update(memory.tuned, sample, given, limits)
        return PolicyMemory(terms.effort, memory.taken + 1, after), terms._replace(held=False)

    return Law(
        POLICY,
        POLICY,
        tuned.config,
        gains if by_gains else torque,
        PolicyMemory(0.0, 0, tuned.memory),
        tuned.terms if by_gains else TorqueTerms,
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
    law = policy_law(actions, law_of(config), task.constants is not None)
    controllers = {POLICY: Controller(config, law)}
    with suppress(DivergedError):  # as in the environment: the file says so
        stretches = Engine(run, compiled=False, controllers=controllers).states()
        record_states(plan, stretches, path, (POLICY,), overwrite)
    return path
