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

from trunk_control.law import Hip, Sample, Update
from trunk_control.laws import law_named
from trunk_control.limits import Limits
from trunk_control.pid_family import PidState
from trunk_msgs_util.compiled import compiled, with_arrays
from trunk_msgs_util.recording.joint_table import Floats
from trunk_msgs_util.units import seconds
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.step import Plant, PlantStatus, SensorParameters, act, sense

from ..errors import PlanError
from ..plans.plan import RunPlan
from .linear import linear_drive, observed

_STEP = 1e-6  # of the differences: rad, rad/s, rad s, N m
_INPUTS = 10  # angle, rate, both delayed, five of the law's memory, and the actuator's torque
# Angle, rate, the law's memory (integral, error, measurement, derivative, effort), the actuator's torque.
_OUTPUTS = 8
_MOST_STEPS = 1_000_000  # of a period
WORTH_COMPILING = 200  # samples: compiling takes as long as some thousands in CPython

_QUIET = Disturbance()
_SENSOR = SensorParameters(0.0, 0.0, 0.0, 0.0, None)


class SampledLoop(NamedTuple):
    """Plant and sampled law, without limits, falls, and what an actuator does to small torques alone."""

    plant: Plant
    limits: Limits
    period_ns: int
    control_period_ns: int


class Floquet(NamedTuple):
    """Multipliers over one period; ``growth`` is the largest modulus, per second: unstable above 1."""

    multipliers: Any  # complex array
    period: float  # s
    radius: float
    growth: float


def monodromy_of(update: Update) -> Callable[..., int]:
    """Return a function that linearises a loop with this law's update over one period."""

    def sample(
        z: Floats, x: float, v: float, due: bool, s: SampledLoop, constants: Any
    ) -> tuple[float, ...]:
        """Return the loop's state one period after ``z``: `_INPUTS` numbers in, `_OUTPUTS` out."""
        memory = PidState(z[4], z[5], z[6], z[7], z[8], True)
        measured = sense(PlantState(x, z[2], v, z[3]), _QUIET, 0.0, 0.0, _SENSOR)
        if due:
            dt = seconds(s.control_period_ns)
            hip = Hip(measured.x, measured.x_dot)
            read = Sample(0.0, measured.theta, measured.theta_dot, dt, hip)
            memory, _ = update(memory, read, constants, s.limits)
        before = PlantStatus(PlantState(x, z[0], v, z[1]), z[9], False, False)
        trunk = act(before, memory.effort, _QUIET, s.plant)
        theta, rate = trunk.state.theta, trunk.state.theta_dot
        if trunk.diverged:
            theta, rate = nan, nan
        kept = memory.integral, memory.error, memory.measurement, memory.derivative, memory.effort
        return (theta, rate, *kept, trunk.effort)

    def monodromy_loop(
        v: float,
        steps: int,
        every: int,
        s: SampledLoop,
        constants: Any,
        now: Floats,
        past: Floats,
        z: Floats,
        jacobian: Floats,
        new: Floats,
    ) -> int:
        """Multiply the linearised samples of one period onto ``now`` [8, n] and ``past`` [d, 2, n].

        ``past`` holds angle and rate of the last d samples in a ring. Returns the slot of the oldest.
        The last three are arrays to work in: compiled code allocates nothing.
        """
        size = now.shape[1]
        delay = past.shape[0]
        slot = 0
        for k in range(steps):
            x = v * seconds(k * s.period_ns)
            for column in range(_INPUTS):
                z[column] = _STEP
                above = sample(z, x, v, k % every == 0, s, constants)
                z[column] = -_STEP
                below = sample(z, x, v, k % every == 0, s, constants)
                z[column] = 0.0
                for row in range(_OUTPUTS):
                    jacobian[row, column] = (above[row] - below[row]) / (2.0 * _STEP)
            for j in range(size):
                theta, rate = now[0, j], now[1, j]
                seen_theta, seen_rate = theta, rate
                if delay:
                    seen_theta, seen_rate = past[slot, 0, j], past[slot, 1, j]
                    past[slot, 0, j], past[slot, 1, j] = theta, rate
                for row in range(_OUTPUTS):
                    total = jacobian[row, 0] * theta + jacobian[row, 1] * rate
                    total += jacobian[row, 2] * seen_theta + jacobian[row, 3] * seen_rate
                    for column in range(4, _INPUTS):
                        total += jacobian[row, column] * now[column - 2, j]
                    new[row, j] = total
            for row in range(_OUTPUTS):
                for j in range(size):
                    now[row, j] = new[row, j]
            if delay:
                slot = (slot + 1) % delay
        return slot

    monodromy_loop.__name__ = monodromy_loop.__qualname__ = f"monodromy_{update.__module__}"
    return monodromy_loop


@cache
def _monodromy(controller: str, fast: bool) -> Callable[..., int]:
    function = monodromy_of(law_named(controller).update)
    return compiled(function) if fast else function


class Prepared(NamedTuple):
    """All that a plan's multipliers follow from."""

    controller: str
    loop: SampledLoop
    constants: Any
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
    plant = simulator.plant
    body = with_arrays(plant.body._replace(prescribed=True))
    loop = SampledLoop(
        plant._replace(
            body=body, max_effort=inf, fall_angle=inf, actuator=linear_drive(plant.actuator)
        ),
        config.limits,
        simulator.period_ns,
        config.period_ns,
    )
    every = max(1, round(loop.control_period_ns / loop.period_ns))
    control_period = seconds(every * loop.period_ns)
    speed = abs(simulator.initial_state.x_dot)
    steps = every
    level = body.amplitude == 0.0 and body.harmonics is None
    if speed * body.wavenumber > 0.0 and not level:
        steps = max(1, round(2.0 * pi / (body.wavenumber * speed) / control_period)) * every
        if steps > _MOST_STEPS:
            raise PlanError(f"{steps} samples in one period of the hip: it hardly moves")
        speed = 2.0 * pi / (body.wavenumber * seconds(steps * loop.period_ns))
    return Prepared(
        plan.controller_name, loop, config.constants, speed, steps, every, simulator.delay_steps
    )


def floquet(plan: RunPlan) -> Floquet:
    """Return a plan's multipliers. Raises what `prepared` does."""
    controller, loop, given, speed, steps, every, delay = prepared(plan)
    size = _OUTPUTS + 2 * delay
    identity = np.eye(size)
    now = np.ascontiguousarray(identity[:_OUTPUTS])
    past = np.ascontiguousarray(identity[_OUTPUTS:].reshape(delay, 2, size))
    constants = tuple(with_arrays(part) for part in given)
    work = np.zeros(_INPUTS), np.zeros((_OUTPUTS, _INPUTS)), np.zeros((_OUTPUTS, size))
    monodromy = _monodromy(controller, steps >= WORTH_COMPILING)
    slot = monodromy(speed, steps, every, loop, constants, now, past, *work)
    matrix = np.vstack([now, np.roll(past, -slot, axis=0).reshape(2 * delay, size)])
    period = seconds(steps * loop.period_ns)
    if not np.all(np.isfinite(matrix)):
        return Floquet(np.full(size, np.inf), period, inf, inf)
    # What neither plant nor torque depends on, such as an integral without a gain, has multipliers that move
    # nothing: the integral's is 1.
    kept = observed(matrix, [0, 1])
    multipliers = np.linalg.eigvals(matrix[np.ix_(kept, kept)])
    radius = float(np.max(np.abs(multipliers)))
    return Floquet(multipliers, period, radius, radius ** (1.0 / period))
