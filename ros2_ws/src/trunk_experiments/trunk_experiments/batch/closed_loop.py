"""One closed-loop run as one loop over scalar functions: compiled for batches, the bits of `offline.steps`.

The loop is glue: plant, sensors, disturbances, reference and control law are the functions that the
nodes run. It is ordinary Python as well, so that what numba compiles can be stepped through.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache
from math import isfinite, isnan, nan
from typing import Any, NamedTuple

import numpy as np

from trunk_control.fuzzy_pid import fuzzy_pid_update
from trunk_control.lqr import lqr_update
from trunk_control.pid import PidState, Terms, pid_update
from trunk_control.reference import ReferenceProfile, reference_at
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.units import NANOSECONDS, seconds, step_count
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.integrator import advance
from trunk_sim.plant import PlantParameters, PlantState
from trunk_sim.sensors import SensorParameters, measure
from trunk_sim.simulation import saturate

from ..analysis.metrics import Metrics, metrics
from ..analysis.run_table import RunTable
from ..plans.files import PlanError
from ..plans.plan import RunPlan
from .compiled import compiled, fingerprint

# Rows of a run's result. The first four are the state; the last eight are RunTable's in its order.
X, THETA, X_DOT, THETA_DOT, MEASURED, REFERENCE, TORQUE, KP, KI, KD, ALPHA = range(11)
ROWS = 11

Update = Callable[..., tuple[PidState, Terms]]

# Each law's update and what it takes after (state, reference, measurement, rate, dt).
LAWS: dict[str, tuple[Update, Callable[[Any], tuple[Any, ...]]]] = {
    "pid": (pid_update, lambda config: (config.gains, config.law)),
    "fuzzy_pid": (
        fuzzy_pid_update,
        lambda config: (_with_arrays(config.rules), config.box, config.law),
    ),
    "lqr": (lqr_update, lambda config: (config.gains, config.gravity_torque, config.law)),
}
_START = PidState()  # constants: numba's named tuples know no default values
_QUIET = Disturbance()
update: Update = pid_update  # bound to another law's in that law's twin


class Setting(NamedTuple):
    """What surrounds the control law in one run."""

    initial: PlantState
    plant: PlantParameters
    sensor: SensorParameters
    profile: ReferenceProfile
    signals: Signals
    disturbed: bool  # False: nothing disturbs, whatever ``signals`` says
    delay_steps: int
    joint: int  # 0: the controller measures the hip, 1: the trunk
    substeps: int
    period_ns: int
    control_period_ns: int
    max_effort: float  # N m


def run_loop(setting: Setting, constants: Any, noise: Floats, out: Floats) -> int:
    """Fill ``out`` [ROWS, N + 1] with a run of N steps and return how many of its states are finite.

    ``constants`` are the law's; ``noise`` [N + 1, 2] are standard normal samples, its last row standing
    for all that follow. Fewer than N + 1 finite states: the plant diverged in the step after the last,
    and the columns from there on are not written.
    """
    s = setting
    last = out.shape[1] - 1
    period = seconds(s.period_ns)
    due_after_ns = s.control_period_ns - s.control_period_ns // 1000  # as a Controller has it
    state = s.initial
    memory = _START
    started = False
    last_ns = 0
    reference, kp, ki, kd, alpha = nan, nan, nan, nan, nan
    for k in range(last + 1):
        stamp_ns = k * s.period_ns
        acting = disturbance_at(stamp_ns, s.signals) if s.disturbed else _QUIET
        out[X, k], out[THETA, k], out[X_DOT, k], out[THETA_DOT, k] = state
        seen = max(k - s.delay_steps, 0)
        delayed = PlantState(out[X, seen], out[THETA, seen], out[X_DOT, seen], out[THETA_DOT, seen])
        row = min(k, len(noise) - 1)
        measured = measure(delayed, acting, noise[row, 0], noise[row, 1], s.sensor)
        position, rate = measured.theta, measured.theta_dot
        if s.joint == 0:
            position, rate = measured.x, measured.x_dot
        if not started or stamp_ns - last_ns >= due_after_ns:
            dt = seconds(stamp_ns - last_ns if started else s.control_period_ns)
            wanted = reference_at(stamp_ns, s.profile)
            memory, terms = update(memory, wanted, position, rate, dt, *constants)
            if not isnan(terms.unsaturated):  # not held
                started = True
                last_ns = stamp_ns
                reference = wanted
                kp, ki, kd, alpha = terms.kp, terms.ki, terms.kd, terms.alpha
        torque = saturate(memory.effort, s.max_effort)
        out[MEASURED, k] = measured.theta
        out[REFERENCE, k] = reference
        out[TORQUE, k] = torque
        out[KP, k], out[KI, k], out[KD, k], out[ALPHA, k] = kp, ki, kd, alpha
        if k < last:
            state = advance(
                state,
                acting.hip_force,
                torque + acting.trunk_torque,
                period,
                s.substeps,
                s.plant,
            )
            if not (
                isfinite(state.x)
                and isfinite(state.theta)
                and isfinite(state.x_dot)
                and isfinite(state.theta_dot)
            ):
                return k + 1
    return last + 1


@cache
def compiled_loop(controller: str) -> Callable[[Setting, Any, Floats, Floats], int]:
    """Return `run_loop`, compiled with a controller's law. Raises PlanError for one without a twin."""
    if controller not in LAWS:
        raise PlanError(
            f"controller {controller!r} has no compiled loop; there are {', '.join(LAWS)}"
        )
    return compiled(run_loop, f"run_loop_{controller}", update=LAWS[controller][0])


def loops_fingerprint() -> str:
    """Return a hash of all sources that decide a compiled run's numbers."""
    return "-".join(fingerprint(run_loop, update=law) for law, _ in LAWS.values())


class Outcome(NamedTuple):
    """A run's table up to the last finite state; ``diverged_at`` [s] is None where all are finite."""

    table: RunTable
    diverged_at: float | None

    def metrics(self) -> Metrics | None:
        """Return the metrics; None for a run that diverged."""
        return None if self.diverged_at is not None else metrics(self.table)


class Batch:
    """Runs plans one after another in memory that is used again: a result lasts until the next run."""

    def __init__(self) -> None:
        self._out = np.empty((ROWS, 0))

    def run(self, plan: RunPlan) -> Outcome:
        """Run a plan by compiled code. Raises PlanError for a plan without an end or a compiled loop."""
        simulator = plan.simulator
        if not simulator.duration:
            raise PlanError("simulator: duration is 0: an offline run needs an end; set it in s")
        loop = compiled_loop(plan.controller_name)
        states = step_count(simulator.duration, simulator.update_rate) + 1
        if self._out.shape[1] != states:
            self._out = np.empty((ROWS, states))
        finite = loop(setting_of(plan), constants_of(plan), _noise(plan, states), self._out)
        t = _times(states, simulator.period_ns)
        table = RunTable(t[:finite], *self._out[:, :finite])
        return Outcome(table, float(t[finite - 1]) if finite < states else None)


def setting_of(plan: RunPlan) -> Setting:
    """Return what surrounds the control law in a plan's run."""
    simulator, controller, disturbance = plan.simulator, plan.controller, plan.disturbance
    # None instead of False: the branch is known when the loop is compiled, and goes; a third of the time
    # with it, for a sine and a cosine of one angle are then computed together.
    prescribed: Any = simulator.plant.prescribed or None
    return Setting(
        simulator.initial_state,
        simulator.plant._replace(prescribed=prescribed),
        simulator.sensor,
        _with_arrays(controller.reference),
        _quiet() if disturbance is None else _with_arrays(disturbance.signals),
        disturbance is not None,
        simulator.delay_steps,
        simulator.joints.index(controller.joint),
        simulator.substeps,
        simulator.period_ns,
        controller.period_ns,
        simulator.max_effort,
    )


def constants_of(plan: RunPlan) -> tuple[Any, ...]:
    """Return what a plan's control law takes beside the sample."""
    constants: tuple[Any, ...] = LAWS[plan.controller_name][1](plan.controller)
    return constants


_INTEGERS = {"pulse_starts", "times"}  # fields of ns


def _with_arrays(record: Any) -> Any:
    """Return a named tuple with its tuples as arrays, so that their lengths are no part of its type."""
    return record._make(
        np.array(value, dtype=np.int64 if name in _INTEGERS else np.float64)
        if isinstance(value, tuple)
        else value
        for name, value in zip(record._fields, record, strict=True)
    )


@cache
def _quiet() -> Signals:
    none: Signals = _with_arrays(Signals(0, (), 0, 0.0, 0, 0.0, 0.0, 0.0, 0, 0.0, (), ()))
    return none


_NO_NOISE = np.zeros((1, 2))


def _noise(plan: RunPlan, states: int) -> Floats:
    """Return the samples that a NoiseStream yields, or a row of zeros where none is used."""
    sensor = plan.simulator.sensor
    if sensor.position_noise == 0.0 and sensor.velocity_noise == 0.0:
        return _NO_NOISE
    generator = np.random.Generator(np.random.PCG64(plan.simulator.seed))
    return generator.standard_normal((states, 2))


@lru_cache(maxsize=8)
def _times(states: int, period_ns: int) -> Floats:
    return np.arange(states) * period_ns / NANOSECONDS
