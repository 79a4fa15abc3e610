"""A run's states from the closed loop, segment by segment between changes of parameters, as tables.

Compiled code computes them where that is possible and faster, CPython otherwise; both give the same bits, and
hand the same table of consecutive states to the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from math import inf
from typing import Any, NamedTuple

import numpy as np

from trunk_control.controller import Controller
from trunk_control.decide import Output, state_record
from trunk_control.law import Law
from trunk_core.arrays import Floats, Integers
from trunk_core.compiled import refusal, twin
from trunk_core.errors import PlanError
from trunk_core.units import seconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.plant import PlantState
from trunk_sim.simulation import DivergedError, diverged
from trunk_sim.step import Dynamics, Measurement, PlantConstants, PlantStatus, at_rest, noisy

from .loop import (
    DIVERGED,
    FELL,
    Instant,
    LoopState,
    NoiseRows,
    PlannedSchedule,
    Schedule,
    Seen,
    Surroundings,
    beginning,
    chain_of,
    check,
    compiled_participants,
    for_compiler,
    participants_of,
    reads_state,
    schedule_for_compiler,
    segment_of,
    states_of,
    surroundings_of,
    values_in,
    wire_of,
)
from .plan import RunPlan
from .timeline import Timeline, begins_active

# Columns of the table. A position or velocity has two: hip, trunk.
POSITION, VELOCITY = slice(0, 2), slice(2, 4)  # true
SEEN_POSITION, SEEN_VELOCITY = slice(4, 6), slice(6, 8)  # measured
APPLIED = 8  # N m, over the previous step
ACTING, OFFSET = slice(9, 11), slice(11, 13)  # disturbance: N and N m; m and rad
EFFORT = 13  # N m, the command
FRESH = 14  # 1.0 where the law was updated: the terms are those of this update
REFERENCE = 15  # rad, of the controller that answers
SEEN_APPLIED = 16  # N m, over the step before the one that is measured
ACTIVE = 17  # which controllers are active: the sum of 2^i over their places i
FALLEN = 18  # 1.0 from the state on in which the trunk has fallen
TERMS = 19  # and following: a law's record of an update, by `Law.record_names`

# A signal waits for the end of a stretch at most; a stretch also fits into the cache.
_LONGEST = 4096  # states
_SUBSTEPS = 1 << 18  # Runge-Kutta steps


class States(NamedTuple):
    """N consecutive states, and the rows in which something irregular happens."""

    first: int  # the first one's index
    table: Floats  # [N, columns]
    acts: list[tuple[int, str]]  # which controller answers from a row on; empty: none
    turned: list[tuple[int, str, bool]]  # made active or inactive by the schedule, before the row
    falls: list[int]  # the trunk fell in these rows
    term_names: Mapping[str, tuple[str, ...]]  # the names of each controller's terms

    def answers(self) -> Iterator[tuple[str, slice]]:
        """Yield which controller answers in which rows; rows without one are left out."""
        ends = [row for row, _ in self.acts[1:]] + [len(self.table)]
        for (begin, name), end in zip(self.acts, ends, strict=True):
            if name:
                yield name, slice(begin, end)

    def acting(self, row: int) -> str:
        """Return the controller that answers the state of a row; empty: none."""
        return [name for since, name in self.acts if since <= row][-1]


def longest(substeps: int) -> int:
    """Return how many states are computed at a time."""
    return max(1, min(_LONGEST, _SUBSTEPS // substeps))


def keep_states(out: Floats, row: int, instant: Instant, plant: PlantConstants) -> None:
    """Write a state into a row of ``out``, except its terms. Compiles unchanged."""
    state, measured, disturbance = instant.trunk.state, instant.measured, instant.disturbance
    out[row, 0], out[row, 1], out[row, 2], out[row, 3] = (
        state.x,
        state.theta,
        state.x_dot,
        state.theta_dot,
    )
    out[row, 4], out[row, 5] = measured.x, measured.theta
    out[row, 6], out[row, 7] = measured.x_dot, measured.theta_dot
    out[row, 8] = instant.trunk.effort
    out[row, 9], out[row, 10] = disturbance.hip_force, disturbance.trunk_torque
    out[row, 11], out[row, 12] = disturbance.hip_offset, disturbance.trunk_offset
    out[row, 13] = instant.decision.effort
    out[row, 14] = 1.0 if instant.decision.updated else 0.0
    out[row, 15] = instant.decision.reference
    out[row, 16] = instant.measured_torque
    out[row, 17] = instant.decision.active
    out[row, 18] = 1.0 if instant.trunk.fallen else 0.0


def write_terms(law: Law) -> Callable[[Floats, int, Output, Measurement], None]:
    """Return the function that writes the terms of a law's update into a row of ``out``."""

    def write_down(out: Floats, row: int, answer: Output, measured: Measurement) -> None:
        said = state_record(answer, measured.theta)
        for i in range(len(said)):
            out[row, TERMS + i] = said[i]

    return write_down


class SegmentInputs(NamedTuple):
    """What a segment takes, as `loop.segment_of` has it, but controllers instead of participants."""

    surroundings: Surroundings
    state: LoopState
    controllers: Sequence[Controller]
    noise: Floats
    history: Floats
    schedule: Schedule
    out: Floats


Code = Callable[[int, int, SegmentInputs], tuple[int, int, LoopState]]

# Runge-Kutta steps. Loading compiled code takes 0.7 s, and compiling it, once for each version, some seconds;
# it saves some ten microseconds in each.
WORTH_COMPILING = 40_000
ENDLESS_S = 600.0  # how long an endless run counts as


def worth_compiling(config: SimulatorConfig) -> bool:
    """Return True for a run that is long enough to make up for loading a loop's compiled code."""
    steps = (config.duration or ENDLESS_S) * config.update_rate
    return steps * config.substeps >= WORTH_COMPILING


def code_for(
    plan: RunPlan, dynamics: Dynamics, inputs: SegmentInputs, compiled: bool | None
) -> Code:
    """Return the loop of a run with a plant's equations: compiled, where that pays and can be done, or not.

    Raises PlanError for a law that cannot be ``compiled``, ImportError without numba.
    """
    if compiled or (compiled is None and worth_compiling(plan.simulator)):
        try:
            return _compiled_code(plan, dynamics, inputs)
        except (ImportError, PlanError):  # numba is optional but faster
            if compiled:
                raise
    return _plain_code(plan, dynamics, inputs.controllers)


def _plain_code(plan: RunPlan, dynamics: Dynamics, controllers: Sequence[Controller]) -> Code:
    """Return the loop in CPython."""
    segment = _loop_of(dynamics, *(controller.law for controller in controllers))

    def code(first: int, stop: int, inputs: SegmentInputs) -> tuple[int, int, LoopState]:
        surroundings, state, controllers, *arrays = inputs
        chain = participants_of(
            ((c.config, c.settings, c.constants) for c in controllers),
            plan.simulator.joints,
        )
        return segment(first, stop, surroundings, state, chain, *arrays)

    return code


@lru_cache(32)
def _loop_of(dynamics: Dynamics, *laws: Law) -> Callable[..., tuple[int, int, LoopState]]:
    return segment_of(*laws, dynamics=dynamics, keep=keep_states, tell=write_terms)


def _compiled_code(plan: RunPlan, dynamics: Dynamics, inputs: SegmentInputs) -> Code:
    """Return the loop as compiled code, after a call that computes no state. Raises as `code_for` does."""
    segment = _loop_of(dynamics, *(controller.law for controller in inputs.controllers))

    def given(inputs: SegmentInputs) -> tuple[Any, ...]:
        surroundings, state, controllers, noise, history, schedule, out = inputs
        chain = compiled_participants(controllers, plan.simulator.joints)
        arrays = noise, history, schedule_for_compiler(schedule), out
        return for_compiler(surroundings), state, chain, *arrays

    if reason := refusal(segment, 0, 0, *given(inputs)):
        laws = ", ".join(controller.law.name for controller in inputs.controllers)
        raise PlanError(f"{laws}: not compilable: {reason}")
    quick = twin(segment)
    return lambda first, stop, inputs: quick(first, stop, *given(inputs))


def states_of_run(plan: RunPlan, compiled: bool | None = None) -> Iterator[States]:
    """Yield the states of a run in their order; ``compiled``: by compiled code; None: where it pays.

    Raises PlanError for a plan that cannot be run offline, or if compiled code cannot run it, DivergedError
    after the last finite state, ImportError for ``compiled`` without numba.
    """
    check(plan)
    return Engine(plan, compiled=compiled).states()


def _command_index(plan: RunPlan) -> Integers | None:
    """Return the state whose command is in force in each state, -1: none; None: always its own."""
    inputs, states = plan.inputs, states_of(plan)
    if inputs is None or inputs.command is not None:
        return None
    given = np.where(inputs.command_ns >= 0, inputs.command_ns // plan.simulator.period_ns, -1)
    index: Integers = np.append(given, np.arange(len(given), states))
    return index[:states]


# The schedule of the states with indices in [first, stop).
Given = Callable[[int, int], Schedule]


class RecordSource(NamedTuple):
    """What a recording puts in place of a run's own course: it goes on from each recorded state.

    ``seen``: for controllers that did not get every state. ``stamps``: of the states, ns, where they are not
    those of our plant.
    """

    given: Given
    seen: Seen | None = None
    stamps: Integers | None = None


class Engine:
    """Runs a plan, and can be asked between any two states."""

    def __init__(
        self,
        plan: RunPlan,
        record: RecordSource | None = None,
        compiled: bool | None = None,
        controllers: Mapping[str, Controller] | None = None,
    ) -> None:
        """Take other ``controllers`` than those that the plan configures, if they are given.

        A ``record``'s states go on after a fall, and may have any number of active controllers. Raises
        PlanError and ImportError as `states_of_run` does.
        """
        self.plan = plan
        self.index = 0
        self.controllers = controllers or {
            name: Controller(config) for name, config in plan.controllers.items()
        }
        for name, controller in self.controllers.items():
            if not begins_active(plan.controllers[name], plan.changes.get(name, ())):
                controller.deactivate()
        simulator = plan.simulator
        trunk = at_rest(simulator.initial_state, simulator.plant)
        self._side = _PlantSide(simulator, trunk)
        self._state = beginning(trunk, ())
        self._fallen = False
        self._history = np.empty((simulator.delay_steps + 1, 4))
        self.wire = wire_of(simulator.network, states_of(plan), _command_index(plan))
        # Only a recorded run has a gap between two controllers.
        self._by_hand = any(plan.changes.get(name) for name in self.controllers)
        self._given_states = 0 if plan.inputs is None else len(plan.inputs)
        self._record = record
        planned = PlannedSchedule(plan)
        self._given = planned if record is None else record.given
        self._stamps = None if record is None else record.stamps
        seen = planned.seen if record is None else record.seen
        self._timelines = {
            name: Timeline(
                plan.configs[name],
                plan.changes.get(name, ()),
                (lambda _: None) if seen is None else partial(seen, name),
            )
            for name in self.controllers
        }
        self._of_simulator = plan.timeline("simulator")
        self._of_disturbance = None if plan.disturbance is None else plan.timeline("disturbance")
        self._of_simulator.advance(-1)
        self._length = longest(plan.simulator.substeps)
        self._noise = NoiseRows(plan.simulator.seed, self._length)
        self._compiled = compiled
        self._code: dict[Dynamics, Code] = {}  # a change of parameters may choose other equations

    def _stamp_ns(self, index: int) -> int:
        if self._stamps is not None:
            return int(self._stamps[index])
        return index * self.plan.simulator.period_ns

    @property
    def disturbance(self) -> DisturbanceConfig | None:
        """The disturbance's configuration in force."""
        return None if self._of_disturbance is None else self._of_disturbance.config

    def take_effect(self) -> None:
        """Apply all that changes between the state before and the one with index `index`."""
        stamp_ns = self._stamp_ns(self.index)
        before_ns = self._stamp_ns(self.index - 1) + 1 if self.index else 0
        for name, timeline in self._timelines.items():
            timeline.advance(stamp_ns, self.controllers[name])
        self._side.index = self.index
        if self._of_simulator.advance(before_ns, self._side) and self._side.anew:
            trunk, self._side.anew = self._side.trunk, False
            self._state = self._state._replace(trunk=trunk)
            self._fallen = trunk.fallen and self.index > 0
        if self._of_disturbance is not None:
            self._of_disturbance.advance(stamp_ns)

    def jump(self, index: int, state: PlantState, effort: float, fallen: bool) -> None:
        """Go on from a recorded state, with this torque over the step before it [N m]."""
        self.index = index
        self.take_effect()
        trunk = PlantStatus(state, effort, fallen, False)
        self._state = self._state._replace(trunk=trunk, begun=False)
        self._side.remembered, self._fallen = index, fallen

    def _divergence(self) -> DivergedError:
        state = self._state
        stamp_ns = self._stamp_ns(self.index - 1)
        return diverged(stamp_ns, state.trunk, state.effort, self._side.config)

    def states(self, stop: int | None = None) -> Iterator[States]:
        """Yield the states up to the run's end, or to the one before index ``stop``. Raises DivergedError."""
        end = states_of(self.plan) if stop is None else stop
        while self.index < end:
            self.take_effect()
            window = self.index - self.index % self._length + self._length
            if self.index < self._given_states:
                window = min(window, self._given_states)
            states, why = self._segment(min(end, window, self._next_change()))
            if len(states.table):
                yield states
            if why == DIVERGED:
                raise self._divergence()
            if why == FELL:
                return

    def _next_change(self) -> int:
        """Return the index of the first state after this one before which something changes."""
        timelines: list[Timeline] = [*self._timelines.values()]
        if self._of_disturbance is not None:
            timelines.append(self._of_disturbance)
        first_ns = min((line.next_ns for line in timelines), default=inf)
        if self._stamps is not None:
            return max(int(np.searchsorted(self._stamps, first_ns, "right")), self.index + 1)
        period_ns = self.plan.simulator.period_ns
        rows = [int(first_ns) // period_ns + 1] if first_ns < inf else []
        if (plant_ns := self._of_simulator.next_ns) < inf:
            rows.append(-(-int(plant_ns) // period_ns) + 1)
        return max(min(rows, default=1 << 62), self.index + 1)

    def _segment(self, stop: int) -> tuple[States, int]:
        """Compute the states up to an index, which no change separates."""
        first, names = self.index, list(self.controllers)
        disturbance = None if self._of_disturbance is None else self._of_disturbance.config
        surroundings = surroundings_of(
            self._side.config, disturbance, self.wire, self._side.remembered
        )
        if self._record is not None:
            surroundings = surroundings._replace(fall_stop=False)
        controllers = list(self.controllers.values())
        before = [controller.active for controller in controllers]
        state = self._state._replace(memories=chain_of([c.state for c in controllers]))
        records = {name: c.law.record_names for name, c in self.controllers.items()}
        out = np.empty((stop - first, TERMS + max(map(len, records.values()), default=0)))
        given = self._given(first, stop)
        inputs = SegmentInputs(
            surroundings,
            state,
            controllers,
            self._noise.rows(first, stop, noisy(surroundings.sensor)),
            self._history,
            given,
            out,
        )
        dynamics = self._side.config.dynamics
        if dynamics not in self._code:
            code = code_for(self.plan, dynamics, inputs, self._compiled)
            self._code[dynamics] = code
        self.index, why, self._state = self._code[dynamics](first, stop, inputs)
        for controller, after in zip(controllers, values_in(self._state.memories), strict=True):
            controller.state = after
        table = out[: self.index - first]
        active = table[:, ACTIVE].astype(np.int64)
        acts, turned = self._turns(first, names, before, active, given.reads)
        fallen = table[:, FALLEN] != 0.0
        falls = np.flatnonzero(fallen & ~np.append(self._fallen, fallen[:-1])[: len(fallen)])
        self._fallen = bool(fallen[-1]) if len(fallen) else self._fallen
        return States(first, table, acts, turned, falls.tolist(), records), why

    def _turns(
        self, first: int, names: list[str], before: list[bool], active: Any, reads: Any
    ) -> tuple[list[tuple[int, str]], list[tuple[int, str, bool]]]:
        """Return which controller answers from which row on, and the turns of the schedule, by row.

        A state that a controller was not given (``reads``) turns nothing, and is answered by nobody.
        Raises PlanError unless exactly one is active, or none in a run that was changed by hand.
        """
        acts: list[tuple[int, str]] = []
        turned: list[tuple[int, str, bool]] = []
        last = sum(1 << place for place, active in enumerate(before) if active)
        changes = {0, *np.flatnonzero(np.diff(active, prepend=last)).tolist()}
        if reads is not None and len(reads):
            changes.update(
                (np.flatnonzero(np.diff(reads[: len(active)], axis=0).any(1)) + 1).tolist()
            )
        for row in sorted(changes) if len(active) else ():
            mask = int(active[row])
            acting = [name for place, name in enumerate(names) if mask >> place & 1]
            expected = self._record is not None or first < self._given_states
            expected = expected or (self._by_hand and not acting)
            if len(acting) != 1 and not expected:
                at = seconds(self._stamp_ns(first + row))
                raise PlanError(
                    f"{len(acting)} controllers are active at t = {at:g} s: "
                    "exactly one must act at any time; see active.times"
                )
            acts.append((row, acting[0] if acting else ""))
            for place, name in enumerate(names):
                if (mask ^ last) >> place & 1 and reads_state(row, place, reads):
                    turned.append((row, name, bool(mask >> place & 1)))
                    last ^= 1 << place
        return acts, turned


class _PlantSide:
    """What changes of the simulator's parameters, and resets, act on."""

    def __init__(self, config: SimulatorConfig, trunk: PlantStatus) -> None:
        self.config, self.trunk = config, trunk
        self.index = 0
        self.remembered = 0  # the oldest state that the sensors have not forgotten
        self.anew = False

    def reconfigure(self, config: SimulatorConfig) -> None:
        """Take other parameters; the state stays."""
        self.config = config

    def reset(self) -> None:
        """Return the plant to its initial state; the sensors forget the past."""
        self.trunk = at_rest(self.config.initial_state, self.config.plant)
        self.remembered, self.anew = self.index, True
