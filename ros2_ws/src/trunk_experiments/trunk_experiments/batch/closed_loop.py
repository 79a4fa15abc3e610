"""One closed-loop run as one loop over pure functions, compiled for batches; same bits as `offline.steps`.

The loop composes the nodes' `sense`, `decide` and `act` and adds no arithmetic. It is also ordinary Python,
so that what numba compiles can be stepped through.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, lru_cache
from math import nan
from typing import Any, NamedTuple

import numpy as np

from trunk_control.computed_torque import Hip
from trunk_control.controller import hip_index, setting_of
from trunk_control.decide import Memory, Reading, Seen, Setting, decide, fresh_memory
from trunk_control.law import Law
from trunk_control.laws import law_named
from trunk_msgs_util.compiled import compiled_or_plain, fingerprint, with_arrays
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.units import NANOSECONDS, step_count
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.noise import noise_samples
from trunk_sim.plant import PlantState
from trunk_sim.step import (
    Measurement,
    Plant,
    SensorParameters,
    act,
    at_rest,
    noisy,
    pruned,
    saturate,
    sense,
)

from ..analysis.metrics import Metrics, metrics
from ..analysis.run_table import RunTable
from ..errors import PlanError
from ..plans.nodes import CONTROLLERS
from ..plans.plan import RunPlan, check_turns
from ..runs.offline import check

# Rows of a run's result. The first four are the state; all are RunTable's, in its order.
X, THETA, X_DOT, THETA_DOT, MEASURED, REFERENCE, TORQUE, KP, KI, KD, ALPHA = range(11)
ROWS = 11

_QUIET = Disturbance()  # constants: numba's named tuples know no default values
_STILL = Hip()


class Surroundings(NamedTuple):
    """What surrounds the controllers in one run."""

    initial: PlantState
    plant: Plant
    sensor: SensorParameters
    signals: Signals
    disturbed: bool  # False: nothing disturbs, whatever ``signals`` holds
    delay_steps: int
    period_ns: int
    fall_stop: bool


class Participant(NamedTuple):
    """A controller in the loop: what `decide` takes, and whose motion it reads besides the trunk's."""

    setting: Setting
    constants: Any
    hip: int  # 0: the hip's, 1: the trunk's, -1: none


class Acted(NamedTuple):
    """What the loop takes of a controller's answer: of the same type for all laws."""

    active: bool
    fresh: bool
    effort: float  # N m
    reference: float  # rad
    kp: float  # NaN where a law has no gains
    ki: float
    kd: float
    alpha: float


# Nested pairs, ``(first, (second, ()))``: each law's constants have a different type.
Chain = tuple[Any, ...]
Decided = tuple[Chain, Acted]
Gains4 = tuple[float, float, float, float]


def reading_of(stamp_ns: int, measured: Measurement, effort: float, hip: int) -> Reading:
    """Return a measured state as read by a controller that uses this joint as the hip."""
    motion = _STILL
    if hip == 0:
        motion = Hip(measured.x, measured.x_dot)
    elif hip == 1:
        motion = Hip(measured.theta, measured.theta_dot)
    return Reading(stamp_ns, measured.theta, measured.theta_dot, motion, effort, False, 0.0)


def gains_told(terms: Any) -> Gains4:
    """Return Kp, Ki, Kd and alpha of an update."""
    return terms.kp, terms.ki, terms.kd, terms.alpha


def no_gains(terms: Any) -> Gains4:
    """Return those of a law that tells none."""
    return nan, nan, nan, nan


def gains_of(law: Law) -> Callable[[Any], Gains4]:
    """Return the function of a law's terms that returns its gains."""
    return gains_told if {"kp", "ki", "kd", "alpha"} <= set(law.terms._fields) else no_gains


def decide_by(law: Law, others: Callable[..., Decided] | None) -> Callable[..., Decided]:
    """Return a function that decides for a law's controller and then for the ``others``.

    It takes ``(memories, participants, stamp_ns, measured, effort)``, memories and participants as
    `Chain`, and returns the next memories and what the one whose turn it is answers.
    """
    update, take_over = law.update, law.take_over
    gains = gains_of(law)

    def last(
        memories: Chain, participants: Chain, stamp_ns: int, measured: Measurement, effort: float
    ) -> Decided:
        one = participants[0]
        reading = reading_of(stamp_ns, measured, effort, one.hip)
        memory, a = decide(memories[0], reading, one.setting, one.constants, update, take_over)
        kp, ki, kd, alpha = gains(a.terms)
        return (memory, ()), Acted(a.active, a.fresh, a.effort, a.reference, kp, ki, kd, alpha)

    if others is None:
        return last

    def first(
        memories: Chain, participants: Chain, stamp_ns: int, measured: Measurement, effort: float
    ) -> Decided:
        one = participants[0]
        reading = reading_of(stamp_ns, measured, effort, one.hip)
        memory, a = decide(memories[0], reading, one.setting, one.constants, update, take_over)
        kp, ki, kd, alpha = gains(a.terms)
        acted = Acted(a.active, a.fresh, a.effort, a.reference, kp, ki, kd, alpha)
        rest, other = others(memories[1], participants[1], stamp_ns, measured, effort)
        return (memory, rest), acted if acted.active else other

    return first


def loop_of(*laws: Law) -> Callable[..., tuple[int, bool]]:
    """Return the loop of a run with these laws, in the order of its participants.

    ``loop(surroundings, memories, participants, noise, out)`` fills ``out`` [ROWS, N + 1] with a run of N
    steps and returns the number of states, and True if the plant diverged in the step after the
    last of them. A run that ends with a fall has fewer than N + 1, too. Later columns are not
    written. ``noise`` [N + 1, 2] are standard normal samples; its last row is used for all that follow.
    """
    decide_all: Callable[..., Decided] | None = None
    for law in reversed(laws):
        decide_all = decide_by(law, decide_all)
    if decide_all is None:
        raise ValueError("a loop needs a law")

    def loop(
        surroundings: Surroundings,
        memories: Chain,
        participants: Chain,
        noise: Floats,
        out: Floats,
    ) -> tuple[int, bool]:
        s = surroundings
        last = out.shape[1] - 1
        trunk = at_rest(s.initial, s.plant)
        reference, kp, ki, kd, alpha = nan, nan, nan, nan, nan
        for k in range(last + 1):
            stamp_ns = k * s.period_ns
            acting = disturbance_at(stamp_ns, s.signals) if s.disturbed else _QUIET
            state = trunk.state
            out[X, k], out[THETA, k], out[X_DOT, k], out[THETA_DOT, k] = state
            seen = max(k - s.delay_steps, 0)
            delayed = PlantState(
                out[X, seen], out[THETA, seen], out[X_DOT, seen], out[THETA_DOT, seen]
            )
            row = min(k, len(noise) - 1)
            measured = sense(delayed, acting, noise[row, 0], noise[row, 1], s.sensor)
            memories, answer = decide_all(memories, participants, stamp_ns, measured, trunk.effort)
            if answer.fresh:
                reference = answer.reference
                kp, ki, kd, alpha = answer.kp, answer.ki, answer.kd, answer.alpha
            out[MEASURED, k] = measured.theta
            out[REFERENCE, k] = reference
            out[TORQUE, k] = saturate(answer.effort, s.plant.max_effort)
            out[KP, k], out[KI, k], out[KD, k], out[ALPHA, k] = kp, ki, kd, alpha
            if s.fall_stop and trunk.fallen:
                return k + 1, False
            if k < last:
                trunk = act(trunk, answer.effort, acting, s.plant)
                if trunk.diverged:
                    return k + 1, True
        return last + 1, False

    loop.__name__ = loop.__qualname__ = "_".join(["loop", *(law.update.__module__ for law in laws)])
    return loop


@cache
def compiled_loop(laws: tuple[str, ...]) -> Callable[..., tuple[int, bool]]:
    """Return `loop_of` the named laws, compiled where numba can; if not, a warning says why."""
    loop = loop_of(*(law_named(name) for name in laws))
    return compiled_or_plain(loop, lambda reason: _not_compiled(laws, reason))


def _not_compiled(laws: tuple[str, ...], reason: str) -> None:
    warnings.warn(f"{', '.join(laws)}: not compilable, so CPython runs it: {reason}", stacklevel=4)


def loops_fingerprint() -> str:
    """Return a hash of all sources that determine a compiled run's numbers."""
    return "-".join(fingerprint(loop_of(law_named(name))) for name in CONTROLLERS)


class Outcome(NamedTuple):
    """A run's table up to the last finite state; ``diverged_at`` [s] is None if all are finite."""

    table: RunTable
    diverged_at: float | None

    def metrics(self) -> Metrics | None:
        """Return the metrics; None for a run that diverged."""
        return None if self.diverged_at is not None else metrics(self.table, compiled=True)


class Batch:
    """Runs plans one after another in reused memory: a result lasts until the next run."""

    def __init__(self) -> None:
        self._out = np.empty((ROWS, 0))

    def run(self, plan: RunPlan) -> Outcome:
        """Run a plan in compiled code. Raises PlanError for one that a compiled loop cannot model."""
        check_compilable(plan)
        simulator = plan.simulator
        loop = compiled_loop(tuple(plan.controllers))
        states = step_count(simulator.duration, simulator.update_rate) + 1
        if self._out.shape[1] != states:
            self._out = np.empty((ROWS, states))
        memories, participants = chains_of(plan)
        count, diverged = loop(
            surroundings_of(plan), memories, participants, _noise(plan, states), self._out
        )
        t = _times(states, simulator.period_ns)
        table = RunTable(t[:count], *self._out[:, :count])
        return Outcome(table, float(t[count - 1]) if diverged else None)


def check_compilable(plan: RunPlan) -> None:
    """Raise PlanError for a plan that a compiled loop cannot model."""
    check(plan)
    check_turns(plan)
    if plan.changes:
        raise PlanError(
            f"{', '.join(plan.changes)}: parameters and turns that change by hand while the run goes "
            "on are not compiled: give active.times, or use simulate"
        )


def surroundings_of(plan: RunPlan) -> Surroundings:
    """Return what surrounds the controllers in a plan's run."""
    simulator, disturbance = plan.simulator, plan.disturbance
    return Surroundings(
        simulator.initial_state,
        pruned(simulator.plant),
        simulator.sensor,
        _quiet() if disturbance is None else with_arrays(disturbance.signals),
        disturbance is not None,
        simulator.delay_steps,
        simulator.period_ns,
        simulator.fall_stop,
    )


def chains_of(plan: RunPlan) -> tuple[Chain, Chain]:
    """Return the memories at the start, and the participants, of a plan's controllers."""
    memories: Chain = ()
    participants: Chain = ()
    joints = plan.simulator.joints
    for config in reversed(list(plan.controllers.values())):
        setting = setting_of(config)
        hip = hip_index(config, joints)
        memory: Memory = fresh_memory(not config.active_times, Seen(-1, 0.0), setting.initial)
        memories = (memory, memories)
        participants = (
            Participant(
                with_arrays(setting),
                tuple(with_arrays(one) for one in config.constants),
                -1 if hip is None else hip,
            ),
            participants,
        )
    return memories, participants


@cache
def _quiet() -> Signals:
    none: Signals = with_arrays(Signals(0, (), 0, 0.0, 0, 0.0, 0.0, 0.0, 0, 0.0, (), ()))
    return none


_NO_NOISE = np.zeros((1, 2))


def _noise(plan: RunPlan, states: int) -> Floats:
    """Return the samples of so many steps, or a row of zeros if they have no effect."""
    if not noisy(plan.simulator.sensor):
        return _NO_NOISE
    return noise_samples(plan.simulator.seed, states)


@lru_cache(maxsize=8)
def _times(states: int, period_ns: int) -> Floats:
    return np.arange(states) * period_ns / NANOSECONDS
