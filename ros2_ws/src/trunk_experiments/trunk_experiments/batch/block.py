"""Many runs, in lanes where they fit together, else one after another; the results are the same."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from trunk_control.controller import hip_index, settings_of
from trunk_control.decide import states_per_update
from trunk_control.laws import law_named, law_of
from trunk_control.limits import limited
from trunk_control.pid_family import PidState
from trunk_control.reference import ReferenceProfile
from trunk_msgs_util.compiled import compiled, twin, with_arrays
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.units import seconds, step_count
from trunk_sim.disturbances import Signals
from trunk_sim.noise import noise_samples
from trunk_sim.step import noisy

from ..analysis.metrics import RunMetrics, Sums, metrics_of, no_rows, steady_from
from ..errors import PlanError
from ..plans.plan import RunPlan
from ..runs.loop_inputs import check_compilable
from .compiled_run import Batch
from .lanes import (
    LANES,
    LEFT,
    MEMORY,
    PARAMETERS,
    STATE,
    SUMS,
    Common,
    LaneSeries,
    fill_disturbances,
    fill_references,
    in_common,
    lanes_loop,
    row_values,
    shared,
)

MAX_STATES = 20_000_000  # of a compiled run, all in memory: 1.8 GB


def wrong_duration(duration: float, rate: float) -> str:
    """Return the fault in a run of ``duration`` s at ``rate`` Hz; empty if there is none."""
    if duration == 0.0:
        return "duration is 0 s: a compiled run needs an end"
    states = step_count(duration, rate) + 1
    if states <= MAX_STATES:
        return ""
    return (
        f"{states} states in a run: at most {MAX_STATES} are allowed; shorten it, or lower the rate"
    )


ENOUGH = 4  # runs: a block of lanes takes about as long
_KEPT = 8  # controllers whose values are kept
LONGEST = 200_000  # states: the series of longer runs would take too much memory


class RunSummary(NamedTuple):
    """A run's outcome: its metrics, or when it diverged [s], or why it was refused."""

    metrics: RunMetrics | None
    diverged_at: float | None = None
    refused: str = ""


class Regular(NamedTuple):
    """A run that can be computed in a lane."""

    common: Common
    numbers: list[float]  # of the parameters' rows
    initial: tuple[float, ...]
    effort: float  # N m, before the first update
    profile: ReferenceProfile
    signals: Signals | None
    seed: int | None  # of the sensors' noise; None: there is none


def summaries(plans: Iterable[RunPlan], batch: Batch) -> list[RunSummary]:
    """Return the outcome of each plan's run."""
    outcomes: list[RunSummary] = []
    blocks: dict[Any, list[tuple[int, RunPlan, Regular]]] = {}
    alone: list[tuple[int, RunPlan]] = []
    for i, plan in enumerate(plans):
        outcomes.append(RunSummary(None))
        try:
            check_compilable(plan)
        except PlanError as error:
            outcomes[i] = RunSummary(None, refused=str(error))
            continue
        regular = regular_run(plan)
        if regular is None:
            alone.append((i, plan))
        else:
            key = plan.controller_name, key_of(regular)
            blocks.setdefault(key, []).append((i, plan, regular))
    for (name, _), runs in blocks.items():
        for first in range(0, len(runs), LANES):
            block = runs[first : first + LANES]
            if len(block) < ENOUGH:
                alone += [(i, plan) for i, plan, _ in block]
                continue
            done = run_block(name, [regular for _, _, regular in block])
            for (i, plan, _), outcome in zip(block, done, strict=True):
                if outcome is None:
                    alone.append((i, plan))
                else:
                    outcomes[i] = outcome
    for i, plan in alone:
        outcomes[i] = summary_of(plan, batch)
    return outcomes


def summary_of(plan: RunPlan, batch: Batch) -> RunSummary:
    """Return the outcome of one plan's run."""
    outcome = batch.run(plan)
    try:
        return RunSummary(outcome.metrics(), outcome.diverged_at)
    except ValueError as error:
        return RunSummary(None, refused=str(error))


def _once_an_object(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Keep the results for the latest objects: a sweep's runs have few controllers, whose values recur."""
    kept: deque[tuple[Any, Any]] = deque(maxlen=_KEPT)

    def result_for(argument: Any) -> Any:
        for known, result in tuple(kept):
            if known is argument:
                return result
        result = function(argument)
        kept.append((argument, result))
        return result

    return result_for


_constants = _once_an_object(lambda config: config.constants)
_settings = _once_an_object(settings_of)
_constant_rows = _once_an_object(row_values)
_constants_in_common = _once_an_object(in_common)


def regular_run(plan: RunPlan) -> Regular | None:
    """Return the run of a lane, or None for a plan whose run is not regular, or too long."""
    simulator, disturbance = plan.simulator, plan.disturbance
    states = step_count(simulator.duration, simulator.update_rate) + 1
    if len(plan.controllers) != 1 or plan.controller.active_times or states > LONGEST:
        return None
    if simulator.network is not None:
        return None
    config = plan.controller
    if type(law_of(config).memory) is not PidState:  # the lanes only have rows for this type
        return None
    settings, hip = _settings(config), hip_index(config, simulator.joints)
    if simulator.period_ns > settings.gap_ns:  # every state would start afresh
        return None
    every = states_per_update(simulator.period_ns, settings.period_ns)
    common = Common(
        simulator.plant,
        simulator.sensor,
        settings.limits,
        _constants(config),
        -1 if hip is None else hip,
        states,
        simulator.period_ns,
        simulator.substeps,
        simulator.fall_stop,
        simulator.delay_steps,
        every,
        seconds(settings.period_ns),
        seconds(every * simulator.period_ns),
        steady_from(seconds((states - 1) * simulator.period_ns)),
    )
    records = common.plant, common.sensor, common.limits
    numbers = [number for record in records for number in row_values(record)]
    return Regular(
        common,
        [*numbers, *_constant_rows(common.constants)],
        simulator.initial_state,
        limited(0.0, settings.limits),
        settings.profile,
        None if disturbance is None else disturbance.signals,
        simulator.seed if noisy(simulator.sensor) else None,
    )


def key_of(regular: Regular) -> Any:
    """Return a key that is the same for all runs in a block."""
    c = regular.common
    records = (in_common(record) for record in (c.plant, c.sensor, c.limits))
    return (
        *records,
        _constants_in_common(c.constants),
        c[4:],
        regular.signals is None,
        regular.seed is None,
    )


def run_block(
    name: str, runs: list[Regular], trace: Floats | None = None
) -> list[RunSummary | None]:
    """Return the outcomes of runs with the same `key_of`; None for each that left the regular course.

    ``trace`` [states, TRACED, LANES] is filled, if given.
    """
    common = runs[0].common
    shape = common._replace(
        plant=shared(common.plant), limits=shared(common.limits), constants=shared(common.constants)
    )
    numbers, lookup = len(runs[0].numbers), law_named(name).lookup
    tables = 0 if lookup is None else len(lookup.kind._fields)
    cells = np.zeros((PARAMETERS + numbers + tables, LANES))
    padded = runs + [runs[0]] * (LANES - len(runs))
    cells[PARAMETERS : PARAMETERS + numbers] = np.array([run.numbers for run in padded]).T
    cells[STATE : STATE + 4] = np.array([run.initial for run in padded]).T
    cells[MEMORY + 4] = [run.effort for run in padded]
    cells[SUMS:PARAMETERS] = np.array(no_rows(0.0))[:, None]
    history = np.empty((common.delay_steps + 1, 4 * LANES))
    loop = _compiled_lanes(name, shape, len(runs[0].numbers))
    loop(shape, cells.reshape(-1), series_of(runs), history, _NONE if trace is None else trace)
    return [
        None if cells[LEFT, lane] else _summary(Sums(*cells[SUMS:PARAMETERS, lane].tolist()))
        for lane in range(len(runs))
    ]


_NONE = np.empty((0, 1, 1))


def series_of(runs: list[Regular]) -> LaneSeries:
    """Return the inputs of these runs, step by step: one lane for all if they are equal, else one each."""
    common = runs[0].common
    states, period_ns = common.states, common.period_ns
    profiles = [run.profile for run in runs]
    if all(profile == profiles[0] for profile in profiles):
        reference = _reference(profiles[0], states, period_ns)
    else:
        reference = np.zeros((states, 1, LANES))
        for lane, profile in enumerate(profiles):
            twin(fill_references)(with_arrays(profile), period_ns, lane, reference)
    acting = _NONE
    signals = [run.signals for run in runs if run.signals is not None]
    if signals:
        lanes = 1 if all(signal == signals[0] for signal in signals) else LANES
        acting = np.zeros((states, 4, lanes))
        for lane, signal in enumerate(signals[:lanes]):
            twin(fill_disturbances)(with_arrays(signal), period_ns, lane, acting)
    noise = _NONE
    seeds = [run.seed for run in runs if run.seed is not None]
    if seeds:
        noise = np.zeros((states, 2, LANES))
        for lane, seed in enumerate(seeds):
            noise[:, :, lane] = noise_samples(seed, states)
    return LaneSeries(reference, acting, noise)


@lru_cache(maxsize=8)
def _reference(profile: ReferenceProfile, states: int, period_ns: int) -> Floats:
    reference = np.empty((states, 1, 1))
    twin(fill_references)(with_arrays(profile), period_ns, 0, reference)
    return reference


_loops: dict[tuple[str, int], Callable[..., None]] = {}


def _compiled_lanes(name: str, example: Common, numbers: int) -> Callable[..., None]:
    key = name, numbers
    if key not in _loops:
        _loops[key] = compiled(lanes_loop(law_named(name), example))
    return _loops[key]


def _summary(sums: Sums) -> RunSummary | None:
    try:
        return RunSummary(metrics_of(sums, 0.0))
    except ValueError as error:
        return RunSummary(None, refused=str(error))
