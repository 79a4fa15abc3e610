"""Floquet multipliers of the sampled loop about the upright trunk, with the hip driven along its path.

With the hip prescribed at constant horizontal speed v, the upright trunk (reference 0) is a solution, and
the path shakes it vertically with the period 2 pi / (k v). The loop of plant, delay and sampled law is
linearised there sample by sample, by central differences of the same functions that run it; the product
over one period is the monodromy matrix. If all its eigenvalues are inside the unit circle, small errors
die out.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import inf, nan, pi
from typing import Any, NamedTuple

import numpy as np

from trunk_control.law import Constants, Hip, Limits
from trunk_control.laws import law_named
from trunk_control.state_feedback import StateFeedbackConfig
from trunk_core.arrays import Floats
from trunk_core.compiled import twin, with_arrays
from trunk_core.errors import PlanError
from trunk_core.units import seconds
from trunk_runs.plan import RunPlan
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import TRUNK, PlantState
from trunk_sim.plants.trunk import as_printed, prescribed
from trunk_sim.step import PlantConstants, PlantStatus, act, on_second

from .linear import STEP, law_slopes, linear_drive, observed

_MOST_STEPS = 1_000_000  # of a period
WORTH_COMPILING = 200  # samples: compiling takes as long as some thousands in CPython
_QUIET = Disturbance()


class Floquet(NamedTuple):
    """Multipliers over one period; ``growth`` is the largest modulus, per second: unstable above 1."""

    multipliers: Any  # complex array
    period: float  # s
    radius: float
    growth: float


def plant_slopes(v: float, period_ns: int, plant: PlantConstants, out: Floats) -> None:
    """Write the Jacobian of each step of one period into ``out`` [steps, 3, 4]. Compiles unchanged.

    Of angle, rate and the actuator's torque, by these and the command.
    """
    for k in range(len(out)):
        x = v * seconds(k * period_ns)
        for column in range(4):
            for sign in (1.0, -1.0):
                theta = sign * STEP if column == 0 else 0.0
                rate = sign * STEP if column == 1 else 0.0
                torque = sign * STEP if column == 2 else 0.0
                command = sign * STEP if column == 3 else 0.0
                before = PlantStatus(PlantState(x, theta, v, rate), torque, False, False)
                after = act(before, command, _QUIET, plant, on_second, prescribed)
                scale = nan if after.diverged else sign / (2.0 * STEP)
                out[k, 0, column] += scale * after.state.theta
                out[k, 1, column] += scale * after.state.theta_dot
                out[k, 2, column] += scale * after.effort


@cache
def _plant_slopes(fast: bool) -> Callable[..., None]:
    return twin(plant_slopes) if fast else plant_slopes


class Prepared(NamedTuple):
    """All that a plan's multipliers follow from: without limits, falls, and what has no slope at 0."""

    plant: PlantConstants
    period_ns: int
    controller: str
    constants: Constants
    limits: Limits
    control_period_ns: int
    uses_hip: bool
    speed: float  # m/s
    steps: int  # of a period
    every: int  # steps between updates
    delay: int  # steps


def prepared(plan: RunPlan) -> Prepared:
    """Return a plan's loop about the upright trunk, its hip prescribed at its initial speed.

    The period is rounded to whole control periods and the speed with it. A hip that is not shaken (speed,
    a level path, or wave number 0) gives one control period. Raises PlanError for a period that is too long,
    and for links.
    """
    simulator, config = plan.simulator, plan.controller
    if simulator.network is not None:
        raise PlanError(
            "link.state, link.command, sensor.dropout: a loop over links has no multipliers"
        )
    if simulator.kind.name != TRUNK:
        raise PlanError(f"plant.name: {simulator.kind.name}: multipliers are those of the trunk")
    if simulator.accelerations is as_printed:
        raise PlanError(
            "plant.equations: as_printed: multipliers are those of the derived equations"
        )
    if isinstance(config, StateFeedbackConfig) and (config.x or config.v):
        raise PlanError(
            "state_feedback: gains.x, gains.v: multipliers are those of a hip that is driven, and held by no "
            "gain: set both to 0"
        )
    plant = simulator.plant
    body = with_arrays(plant.constants)
    every = max(1, round(config.period_ns / simulator.period_ns))
    control_period = seconds(every * simulator.period_ns)
    speed = abs(simulator.initial_state.x_dot)
    steps = every
    level = body.amplitude == 0.0 and body.harmonics is None
    if speed * body.wavenumber > 0.0 and not level:
        steps = max(1, round(2.0 * pi / (body.wavenumber * speed) / control_period)) * every
        if steps > _MOST_STEPS:
            raise PlanError(f"{steps} samples in one period of the hip: it hardly moves")
        speed = 2.0 * pi / (body.wavenumber * seconds(steps * simulator.period_ns))
    return Prepared(
        plant._replace(
            constants=body, max_effort=inf, fall_angle=inf, actuator=linear_drive(plant.actuator)
        ),
        simulator.period_ns,
        plan.controller_name,
        config.constants,
        config.limits,
        config.period_ns,
        config.hip is not None,
        speed,
        steps,
        every,
        simulator.delay_steps,
    )


def floquet(plan: RunPlan) -> Floquet:
    """Return a plan's multipliers. Raises what `prepared` does, and PlanError for a law without slopes."""
    p = prepared(plan)
    plant = np.zeros((p.steps, 3, 4))
    _plant_slopes(p.steps >= WORTH_COMPILING)(p.speed, p.period_ns, p.plant, plant)
    seen_at = (p.speed * seconds((k - p.delay) * p.period_ns) for k in range(0, p.steps, p.every))
    hips = [Hip(x, p.speed) for x in seen_at] if p.uses_hip else [Hip()]
    law = law_slopes(
        law_named(p.controller), p.constants, p.limits, seconds(p.control_period_ns), hips
    )[:, :, :-3]  # the reference stays, and the hip where it is driven
    # Angle, rate, the actuator's torque, the command, the law's memory; then what the sensors will see.
    here = 4 + law.shape[1] - 1
    size = here + 2 * p.delay
    now, past = np.split(np.eye(size), [here])
    past = past.reshape(p.delay, 2, size)  # a ring
    for k in range(p.steps):
        seen = now[:2]
        if p.delay:
            seen = past[k % p.delay].copy()
            past[k % p.delay] = now[:2]
        if k % p.every == 0:
            updated = law[k // p.every % len(law)] @ np.vstack([now[4:], seen])
            now[3], now[4:] = updated[-1], updated[:-1]
        now[:3] = plant[k] @ now[:4]
    oldest = p.steps % p.delay if p.delay else 0
    matrix = np.vstack([now, np.roll(past, -oldest, axis=0).reshape(2 * p.delay, size)])
    period = seconds(p.steps * p.period_ns)
    if not np.all(np.isfinite(matrix)):
        return Floquet(np.full(size, np.inf), period, inf, inf)
    # What neither plant nor torque depends on, such as an integral without a gain, has multipliers that move
    # nothing: the integral's is 1.
    kept = observed(matrix, [0, 1])
    multipliers = np.linalg.eigvals(matrix[np.ix_(kept, kept)])
    radius = float(np.max(np.abs(multipliers)))
    return Floquet(multipliers, period, radius, radius ** (1.0 / period))
