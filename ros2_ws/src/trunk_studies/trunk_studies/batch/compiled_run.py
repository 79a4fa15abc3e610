"""One closed-loop run in compiled code, for batches; same bits as `trunk_runs.engine`."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, lru_cache
from math import nan
from typing import Any, NamedTuple

import numpy as np

from trunk_control.controller import Controller
from trunk_control.decide import Output
from trunk_control.law import Law
from trunk_control.laws import law_named
from trunk_core.arrays import Floats
from trunk_core.compiled import compiled_or_plain
from trunk_core.units import NANOSECONDS
from trunk_evidence.run_metrics import Metrics
from trunk_evidence.run_table import RunTable, metrics
from trunk_runs.loop import (
    DIVERGED,
    Chain,
    Instant,
    LoopState,
    Schedule,
    Surroundings,
    beginning,
    chain_of,
    check_compilable,
    compiled_participants,
    for_compiler,
    segment_of,
    states_of,
    surroundings_of,
    wire_of,
)
from trunk_runs.plan import RunPlan
from trunk_sim.noise import noise_samples
from trunk_sim.step import (
    Dynamics,
    Measurement,
    PlantConstants,
    at_rest,
    noisy,
    torque_of,
)

# Rows of a run's result. The first four are the state; all are RunTable's, in its order.
X, THETA, X_DOT, THETA_DOT, MEASURED, REFERENCE, TORQUE, KP, KI, KD, ALPHA = range(11)
ROWS = 11


Gains4 = tuple[float, float, float, float]


def gains_told(terms: Any) -> Gains4:
    """Return Kp, Ki, Kd and alpha of an update."""
    return terms.kp, terms.ki, terms.kd, terms.alpha


def no_gains(terms: Any) -> Gains4:
    """Return the gains of a law that reports none: NaN."""
    return nan, nan, nan, nan


def gains_of(law: Law) -> Callable[[Any], Gains4]:
    """Return the function of a law's terms that returns its gains."""
    return gains_told if {"kp", "ki", "kd", "alpha"} <= set(law.terms._fields) else no_gains


def tell_gains(law: Law) -> Callable[[Floats, int, Output, Measurement], None]:
    """Return the function that writes a law's reference and gains into column k of ``out`` [ROWS, N]."""
    gains = gains_of(law)

    def write_down(out: Floats, k: int, answer: Output, measured: Measurement) -> None:
        out[REFERENCE, k] = answer.reference
        out[KP, k], out[KI, k], out[KD, k], out[ALPHA, k] = gains(answer.terms)

    return write_down


def keep_rows(out: Floats, k: int, instant: Instant, plant: PlantConstants) -> None:
    """Write state k into column k of ``out`` [ROWS, N]; reference and gains are those of the last update."""
    out[X, k], out[THETA, k], out[X_DOT, k], out[THETA_DOT, k] = instant.trunk.state
    out[MEASURED, k] = instant.measured.theta
    out[TORQUE, k] = torque_of(instant.trunk.effort, instant.effort, plant)
    if not instant.decision.updated:
        for row in (REFERENCE, KP, KI, KD, ALPHA):
            out[row, k] = out[row, k - 1] if k > 0 else nan


def loop_of(*laws: Law, dynamics: Dynamics) -> Callable[..., tuple[int, bool, bool]]:
    """Return the loop of a whole run with these laws, in the order of its participants.

    ``loop(states, surroundings, state, participants, noise, history, schedule, out)`` fills ``out`` [ROWS, N]
    with a run of N ``states`` and returns how many there are, True if the plant diverged in the step after
    the last of them, and True if the trunk fell in one of them. A run that ends with a fall has fewer than N,
    too. Later columns are not written.
    The other arguments are those of `segment_of`.
    """
    segment = segment_of(*laws, dynamics=dynamics, keep=keep_rows, tell=tell_gains)

    def loop(
        states: int,
        surroundings: Surroundings,
        state: LoopState,
        participants: Chain,
        noise: Floats,
        history: Floats,
        schedule: Schedule,
        out: Floats,
    ) -> tuple[int, bool, bool]:
        count, end, after = segment(
            0, states, surroundings, state, participants, noise, history, schedule, out
        )
        return count, end == DIVERGED, after.trunk.fallen

    loop.__name__ = loop.__qualname__ = "_".join(["loop", *(law.update.__module__ for law in laws)])
    return loop


def start_of_loop(plan: RunPlan) -> tuple[Surroundings, LoopState, Chain]:
    """Return a plan's surroundings, the loop before the first state, and the participants."""
    simulator = plan.simulator
    surroundings = surroundings_of(
        simulator, plan.disturbance, wire_of(simulator.network, states_of(plan))
    )
    controllers = [Controller(config) for config in plan.controllers.values()]
    chain = compiled_participants(controllers, simulator.joints)
    trunk = at_rest(simulator.initial_state, simulator.plant)
    memories = chain_of([controller.state for controller in controllers])
    return for_compiler(surroundings), beginning(trunk, memories), chain


class NotCompiledWarning(UserWarning):
    """Laws that numba cannot compile, and the ``reason``: CPython runs them."""

    def __init__(self, laws: tuple[str, ...], reason: str) -> None:
        super().__init__(f"{', '.join(laws)}: not compilable, so CPython runs it: {reason}")
        self.reason = reason


@cache
def compiled_loop(
    laws: tuple[str, ...], dynamics: Dynamics
) -> Callable[..., tuple[int, bool, bool]]:
    """Return `loop_of` the named laws, compiled where numba can; if not, a warning says why."""
    loop = loop_of(*(law_named(name) for name in laws), dynamics=dynamics)
    return compiled_or_plain(loop, lambda reason: _not_compiled(laws, reason))


def _not_compiled(laws: tuple[str, ...], reason: str) -> None:
    warnings.warn(NotCompiledWarning(laws, reason), stacklevel=4)


class Outcome(NamedTuple):
    """A run's table up to the last finite state; ``diverged_at`` [s] is None if all are finite."""

    table: RunTable
    diverged_at: float | None
    fell: bool  # in one of the table's states

    def metrics(self) -> Metrics | None:
        """Return the metrics; None for a run that diverged."""
        return None if self.diverged_at is not None else metrics(self.table, compiled=True)


def run_compiled(plan: RunPlan) -> Outcome:
    """Run a plan in compiled code. Raises PlanError for one that a compiled loop cannot model."""
    check_compilable(plan)
    simulator = plan.simulator
    loop = compiled_loop(tuple(plan.controllers), simulator.dynamics)
    states = states_of(plan)
    surroundings, state, participants = start_of_loop(plan)
    history = np.empty((simulator.delay_steps + 1, 4))
    noise, out = _noise(plan, states), np.empty((ROWS, states))
    count, diverged, fell = loop(
        states, surroundings, state, participants, noise, history, _COMPUTED, out
    )
    t = _times(states, simulator.period_ns)
    return Outcome(
        RunTable(t[:count], *out[:, :count]), float(t[count - 1]) if diverged else None, fell
    )


_NO_NOISE = np.zeros((1, 2))
_COMPUTED = Schedule()


def _noise(plan: RunPlan, states: int) -> Floats:
    """Return the samples of so many steps, or a row of zeros if they have no effect."""
    if not noisy(plan.simulator.sensor):
        return _NO_NOISE
    return noise_samples(plan.simulator.seed, states)


@lru_cache(maxsize=8)
def _times(states: int, period_ns: int) -> Floats:
    return np.arange(states) * period_ns / NANOSECONDS
