"""A run's states, stretch by stretch: by compiled code where that is possible and faster, else by CPython.

Both give the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from trunk_control.controller import Controller
from trunk_control.laws import law_named
from trunk_control.schedule import active_at
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_sim.noise import noise_samples
from trunk_sim.quick import worth_compiling
from trunk_sim.simulation import Simulation, diverged
from trunk_sim.step import Trunk, at_rest, noisy

from ..errors import PlanError
from ..plans.plan import RunPlan
from .loop import (
    DIVERGED,
    GOES_ON,
    Chain,
    Surroundings,
    chains_of,
    check_compilable,
    stretch_of,
    surroundings_of,
)
from .offline import steps
from .states import (
    EFFORT,
    TERMS,
    States,
    in_stretches,
    keep_states,
    longest,
    tell_terms,
)


def states_in_stretches(plan: RunPlan) -> Iterator[States]:
    """Yield the states of a run in their order.

    Raises PlanError for a plan that cannot be run offline, DivergedError after the last finite state.
    """
    if worth_compiling(plan.simulator):
        try:
            return compiled_states(plan)
        except (ImportError, PlanError):
            # numba is optional but faster; CPython runs all that `check_compilable` refuses
            pass
    return in_stretches(steps(plan), longest(plan.simulator.substeps))


def compiled_states(plan: RunPlan) -> Iterator[States]:
    """Return the states of a run by compiled code.

    Raises PlanError for a plan that a compiled loop cannot model, ImportError without numba.
    """
    check_compilable(plan)
    simulator = plan.simulator
    trunk = at_rest(simulator.initial_state, simulator.plant)
    memories, participants = chains_of(plan)
    return _begin(plan, participants, _Start(0, trunk, memories, False))


def compiled_states_from(
    plan: RunPlan, controllers: Mapping[str, Controller], simulation: Simulation
) -> Iterator[States]:
    """Return the states of a run from the simulation's on by compiled code; raises as `compiled_states` does.

    The plan has the configurations in force there; what its sensors still have to see is not known.
    """
    check_compilable(plan)
    memories: Chain = ()
    for name in reversed(list(plan.controllers)):
        memories = (controllers[name].memory, memories)
    trunk = simulation.trunk
    fallen = trunk.fallen and not simulation.falls_now
    return _begin(plan, chains_of(plan)[1], _Start(simulation.step_index, trunk, memories, fallen))


class _Start(NamedTuple):
    """The state with index ``first``; ``fallen``: the trunk fell before it."""

    first: int
    trunk: Trunk
    memories: Chain
    fallen: bool


def _begin(plan: RunPlan, participants: Chain, start: _Start) -> Iterator[States]:
    length = longest(plan.simulator.substeps)
    run = _Run(
        surroundings_of(plan),
        participants,
        _Noise(plan, length),
        np.empty((plan.simulator.delay_steps + 1, 4)),
    )
    stretch = _compiled_stretch(plan, run, (start.trunk, start.memories))
    return _stretches(plan, run, start, stretch, length)


class _Run(NamedTuple):
    """What stays the same from stretch to stretch."""

    surroundings: Surroundings
    participants: Chain
    noise: _Noise
    history: Floats

    def arguments(self, first: int, stop: int, start: tuple[Trunk, Chain], out: Floats) -> Any:
        """Return the arguments of a stretch, as `stretch_of` has them."""
        noise = self.noise.rows(first, stop)
        return first, stop, self.surroundings, *start, self.participants, noise, self.history, out


_compiled: dict[tuple[str, ...], Callable[..., Any]] = {}


def _compiled_stretch(plan: RunPlan, run: _Run, start: tuple[Trunk, Chain]) -> Callable[..., Any]:
    """Return the stretch of a plan's laws, compiled, after a call that computes no state."""
    from trunk_msgs_util.compiled import NumbaError, ready, reason_of

    laws = tuple(plan.controllers)
    if laws not in _compiled:
        stretch = stretch_of(*map(law_named, laws), keep=keep_states, tell=tell_terms)
        out = np.empty((0, TERMS))
        try:
            _compiled[laws] = ready(stretch, *run.arguments(0, 0, start, out))
        except NumbaError as error:
            raise PlanError(f"{', '.join(laws)}: not compilable: {reason_of(error)}") from None
    return _compiled[laws]


def _stretches(
    plan: RunPlan,
    run: _Run,
    begin: _Start,
    stretch: Callable[..., Any],
    length: int,
) -> Iterator[States]:
    plant, states = plan.simulator.plant, run.surroundings.states
    told = {name: law_named(name).record_names for name in plan.controllers}
    columns = TERMS + max(map(len, told.values()))
    first, end, fallen = begin.first, GOES_ON, begin.fallen
    start = begin.trunk, begin.memories
    while end == GOES_ON:
        stop = min(first - first % length + length, states)
        out = np.empty((stop - first, columns))
        done, end, *after = stretch(*run.arguments(first, stop, start, out))
        start = after[0], after[1]
        table = out[: done - first]
        beyond = np.flatnonzero(abs(table[:, 1]) > plant.fall_angle)[: 0 if fallen else 1]
        fallen = fallen or len(beyond) > 0
        yield States(first, table, *_turns(plan, first, done), beyond.tolist(), told)
        first = done
    if end == DIVERGED:
        stamp_ns = (first - 1) * plan.simulator.period_ns
        raise diverged(stamp_ns, start[0], float(table[-1, EFFORT]), plant)


class _Noise:
    """The sensors' samples, many at a time, so that compiled code draws them."""

    _STRETCHES = 16

    def __init__(self, plan: RunPlan, length: int) -> None:
        self._seed = plan.simulator.seed if noisy(plan.simulator.sensor) else None
        self._length = length * self._STRETCHES
        self._first = -1
        self._samples: Floats = np.zeros((1, 2))

    def rows(self, first: int, stop: int) -> Floats:
        """Return the samples of the states in [first, stop), which must lie in one block of samples."""
        if self._seed is None:
            return self._samples
        begin = first - first % self._length
        if begin != self._first:
            self._first = begin
            self._samples = noise_samples(self._seed, self._length, begin)
        return self._samples[first - begin : stop - begin]


def _turns(
    plan: RunPlan, first: int, stop: int
) -> tuple[list[tuple[int, str]], list[tuple[int, str, bool]]]:
    """Return which controller acts, and turns that begin or end, in the states in [first, stop), by row."""
    period_ns = plan.simulator.period_ns
    times = {name: config.active_times_ns for name, config in plan.controllers.items()}
    begins = {-(-time // period_ns) for some in times.values() for time in some}
    acts: list[tuple[int, str]] = []
    turned: list[tuple[int, str, bool]] = []
    for k in sorted({first, *(k for k in begins if first <= k < stop)}):
        for name, some in times.items():
            active = active_at(some, k * period_ns)
            if active and (not acts or acts[-1][1] != name):
                acts.append((k - first, name))
            if active != active_at(some, (k - 1) * period_ns if k else -1):
                turned.append((k - first, name, active))
    return acts, turned
