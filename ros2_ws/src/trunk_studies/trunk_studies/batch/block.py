"""Many runs, in lanes where they fit together, else one after another; the results are the same."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from math import inf, isnan, nan
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trunk_control.controller import hip_index, settings_of
from trunk_control.decide import states_per_update
from trunk_control.law import LawMemory
from trunk_control.laws import law_named, law_of
from trunk_control.reference import ReferenceProfile
from trunk_core.arrays import Floats
from trunk_core.compiled import WITHOUT_NUMBA, refusal, twin, with_arrays
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import ParameterError
from trunk_core.units import seconds, step_count
from trunk_evidence.run_metrics import SETTLING, MetricNumbers, Metrics, metrics_from, steady_from
from trunk_runs.loop import check_compilable
from trunk_runs.plan import RunPlan
from trunk_sim.disturbances import Signals
from trunk_sim.noise import noise_samples
from trunk_sim.plant import PlantState
from trunk_sim.step import Dynamics, noisy

from .compiled_run import run_compiled
from .lanes import (
    BEGINNING,
    LANES,
    ROWS,
    Common,
    LaneSeries,
    fill_disturbances,
    fill_references,
    in_common,
    lanes_loop,
    row_values,
    shared,
    without_row,
)
from .varied import Rows, Varied, by_path, each_run, varies

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

    metrics: Metrics | None
    diverged_at: float | None = None
    refused: str = ""
    fell: bool = False  # by the plan's fall.angle

    @property
    def stood(self) -> bool:
        """True if all states are finite, and none beyond the fall angle."""
        return self.metrics is not None and not self.fell


class Outcomes:
    """How many runs ended, as arrays: a run was refused, or diverged, or has metrics; and whether it fell."""

    def __init__(self, count: int) -> None:
        self.metrics = np.full((len(MetricNumbers._fields), count), nan)  # NaN: undefined
        self.diverged_at = np.full(count, nan)  # s
        self.fell = np.zeros(count, bool)
        self.refused: dict[int, str] = {}

    def keep(self, i: int, summary: RunSummary) -> None:
        """Write down how run i ended."""
        self.fell[i] = summary.fell
        if summary.refused:
            self.refused[i] = summary.refused
        elif summary.metrics is None:
            self.diverged_at[i] = summary.diverged_at
        else:
            values = summary.metrics.as_dict().values()
            self.metrics[:, i] = [nan if value is None else value for value in values]

    def summary(self, i: int) -> RunSummary:
        """Return how run i ended."""
        if reason := self.refused.get(i):
            return RunSummary(None, refused=reason)
        at, fell = float(self.diverged_at[i]), bool(self.fell[i])
        if not isnan(at):
            return RunSummary(None, at, fell=fell)
        return RunSummary(metrics_from(MetricNumbers(*self.metrics[:, i].tolist())), fell=fell)


class Regular(NamedTuple):
    """Runs that can be computed in lanes; what differs between them is a `Varied`."""

    common: Common
    dynamics: Dynamics
    memory: LawMemory  # before the first update
    numbers: list[Any]  # of the rows of memory and parameters
    initial: PlantState
    profile: ReferenceProfile
    signals: Signals | None
    seed: Any  # of the sensors' noise; None: there is none


class Maker(Protocol):
    """What makes runs: on this machine's processor, or on a device."""

    def prepared(self, plan: RunPlan) -> Any:
        """Return a plan, whose numbers may be those of many runs, as `finish` takes it.

        Raises PlanError for a plan that cannot be run, TypeError where its runs cannot be made together.
        """

    def finish(
        self,
        parts: Iterable[tuple[Rows, Any]],
        plan_at: Callable[[int], RunPlan],
        outcomes: Outcomes,
    ) -> None:
        """Make the runs of some parts: their indices, and what `prepared` returned for their plan.

        ``plan_at`` returns a run's own plan.
        """


class Lanes:
    """Makes runs on this machine's processor: in lanes where they fit together, else one after another."""

    def prepared(self, plan: RunPlan) -> tuple[Any, Regular] | None:
        """Return the key of runs that can share a block, and these runs; None: they are made one by one."""
        check_compilable(plan)
        regular = regular_run(plan)
        return None if regular is None else ((plan.controller_name, key_of(regular)), regular)

    def finish(
        self,
        parts: Iterable[tuple[Rows, tuple[Any, Regular] | None]],
        plan_at: Callable[[int], RunPlan],
        outcomes: Outcomes,
    ) -> None:
        """Make the runs of some parts, block by block, and then those that left their block."""
        alone: list[int] = []
        blocks: dict[Any, list[tuple[Rows, Regular]]] = {}
        for rows, prepared in parts:
            if prepared is None:
                alone += rows.tolist()
            else:
                blocks.setdefault(prepared[0], []).append((rows, prepared[1]))
        for (name, _), runs in blocks.items():
            rows = np.concatenate([part for part, _ in runs])
            left, fell, metrics = run_lanes(name, [(len(part), regular) for part, regular in runs])
            alone += rows[left].tolist()
            outcomes.fell[rows[~left]] = fell[~left]
            outcomes.metrics[:, rows[~left]] = metrics[:, ~left]
        for i in alone:
            outcomes.keep(i, summary_of(plan_at(i)))


def make_runs(
    maker: Maker, plan_of: Callable[[Rows], RunPlan], groups: Iterable[Rows], outcomes: Outcomes
) -> None:
    """Make the runs of some groups, each together as far as that goes, and write down how they ended.

    ``plan_of`` returns the plan of some runs of a group, with columns where they differ; of a single run with
    plain numbers. A run that it refuses, by ParameterError or PlanError, is refused.
    """
    parts: list[tuple[Rows, Any]] = []

    def prepared(rows: Rows) -> bool:
        try:
            parts.append((rows, maker.prepared(plan_of(rows))))
        except (TypeError, ParameterError, PlanError) as error:
            if len(rows) > 1:
                return False
            if isinstance(error, TypeError):
                raise
            outcomes.refused[int(rows[0])] = str(error)
        return True

    for group in groups:
        for part, done in by_path(prepared, group):
            for row in () if done else part:
                prepared(np.array([row]))
    maker.finish(parts, lambda i: plan_of(np.array([i])), outcomes)


def summaries(plans: Iterable[RunPlan]) -> list[RunSummary]:
    """Return the outcome of each plan's run."""
    plans = list(plans)
    outcomes = Outcomes(len(plans))
    each = (np.array([i]) for i in range(len(plans)))
    make_runs(Lanes(), lambda rows: plans[rows[0]], each, outcomes)
    return [outcomes.summary(i) for i in range(len(plans))]


def summary_of(plan: RunPlan) -> RunSummary:
    """Return the outcome of one plan's run."""
    outcome = run_compiled(plan)
    try:
        return RunSummary(outcome.metrics(), outcome.diverged_at, fell=outcome.fell)
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
_memory_rows = _once_an_object(partial(row_values, whole=True))
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
    if without_row(law_of(config).memory):
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
        simulator.dynamics,
        settings.initial,
        [*_memory_rows(settings.initial), *numbers, *_constant_rows(common.constants)],
        simulator.initial_state,
        settings.profile,
        None if disturbance is None else disturbance.signals,
        simulator.seed if noisy(simulator.sensor) else None,
    )


def key_of(regular: Regular) -> Any:
    """Return a key that is the same for all runs in a block."""
    c = regular.common
    records = (in_common(record) for record in (c.plant, c.sensor, c.limits))
    return (
        regular.dynamics,
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
    outcomes = Outcomes(len(runs))
    computed = run_lanes(name, [(1, run) for run in runs], 1, trace)
    left, outcomes.fell[:], outcomes.metrics[:] = computed
    return [None if left[i] else outcomes.summary(i) for i in range(len(runs))]


def run_lanes(
    name: str,
    runs: Sequence[tuple[int, Regular]],
    enough: int = ENOUGH,
    trace: Floats | None = None,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Floats]:
    """Return which runs left the regular course; of the others, which fell, and the metrics [metrics, runs].

    ``runs`` have the same `key_of`; each comes with how many it is. Fewer than ``enough`` of a block are
    left, too. ``trace`` [states, TRACED, LANES] is filled, if given.
    """
    common = next(iter(each_run(runs[0][1].common, 1)))
    shape = common._replace(
        plant=shared(common.plant), limits=shared(common.limits), constants=shared(common.constants)
    )
    count, law = sum(n for n, _ in runs), law_named(name)
    given = np.concatenate([spread([*run.numbers, *run.initial], n) for n, run in runs], axis=1)
    inputs = [run_inputs for n, run in runs for run_inputs in inputs_of(run, n)]
    left, fell = np.ones(count, bool), np.zeros(count, bool)
    metrics = np.full((len(MetricNumbers._fields), count), nan)
    history = np.empty((common.delay_steps + 1, 4 * LANES))
    dynamics, numbers = runs[0][1].dynamics, len(runs[0][1].numbers)
    loop = _compiled_lanes(name, dynamics, shape, numbers)
    tables = 0 if law.lookup is None else len(law.lookup.kind._fields)
    for first in range(0, count, LANES):
        block = slice(first, first + LANES)
        used = given[:, block].shape[1]
        if used < enough:
            break
        padded = given[:, first : first + 1].repeat(LANES, 1)
        padded[:, :used] = given[:, block]
        cells = np.zeros((ROWS.memory + numbers + tables, LANES))
        cells[: ROWS.memory] = BEGINNING[:, None]
        cells[ROWS.state : ROWS.state + 4] = padded[numbers:]
        cells[ROWS.memory : ROWS.memory + numbers] = padded[:numbers]
        series = series_of(common, inputs[block])
        if reason := loop(
            shape, cells.reshape(-1), series, history, _NONE if trace is None else trace
        ):
            # numba refuses the law: all are left
            _loops[name, dynamics, numbers] = lambda *given: reason
            break
        metrics[:, block] = cells[ROWS.sums :][: len(metrics), :used]
        left[block] = cells[ROWS.left, :used] != 0.0
        fell[block] = cells[ROWS.fell, :used] != 0.0
    large = np.abs(metrics) == inf
    large[MetricNumbers._fields.index(SETTLING)] = False  # a run that never settles
    left |= large.any(axis=0)  # refused: the run alone says why
    return left, fell, metrics


def spread(numbers: Sequence[Any], count: int) -> Floats:
    """Return numbers, each a float or a column, as an array [numbers, count]."""
    array = np.empty((len(numbers), count))
    for row, number in zip(array, numbers, strict=True):
        row[:] = number.values if isinstance(number, Varied) else number
    return array


_NONE = np.empty((0, 1, 1))


class SeriesInputs(NamedTuple):
    """What compiled code fills a run's series from, and the tuples that these arrays are made of."""

    profile: ReferenceProfile
    signals: Signals | None
    seed: int | None
    arrays: tuple[Any, Any]  # of profile and signals


def inputs_of(regular: Regular, count: int) -> Iterable[SeriesInputs]:
    """Return the inputs of each of a plan's runs."""
    records = regular.profile, regular.signals
    if any(isinstance(part, tuple) and varies(part) for record in records for part in record or ()):
        runs = each_run((*records, regular.seed), count)  # whose tables differ
        return (
            SeriesInputs(profile, signals, seed, (with_arrays(profile), with_arrays(signals)))
            for profile, signals, seed in runs
        )
    arrays = with_arrays(regular.profile), with_arrays(regular.signals)
    return each_run(SeriesInputs(*records, regular.seed, arrays), count)


def series_of(common: Common, runs: Sequence[SeriesInputs]) -> LaneSeries:
    """Return the inputs of these runs, step by step: one lane for all if they are equal, else one each."""
    states, period_ns, first = common.states, common.period_ns, runs[0]
    if all(run.profile == first.profile for run in runs):
        reference = _reference(first.profile, states, period_ns)
    else:
        reference = np.zeros((states, 1, LANES))
        for lane, run in enumerate(runs):
            twin(fill_references)(run.arrays[0], period_ns, lane, reference)
    acting = noise = _NONE
    if first.signals is not None:
        lanes = 1 if all(run.signals == first.signals for run in runs) else LANES
        acting = np.zeros((states, 4, lanes))
        for lane, run in enumerate(runs[:lanes]):
            twin(fill_disturbances)(run.arrays[1], period_ns, lane, acting)
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


_loops: dict[tuple[str, Dynamics, int], Callable[..., str | None]] = {}


def _compiled_lanes(
    name: str, dynamics: Dynamics, example: Common, numbers: int
) -> Callable[..., str | None]:
    """Return the loop of a law's lanes, which returns why numba refuses it, if it does."""
    key = name, dynamics, numbers
    if key not in _loops:
        loop = lanes_loop(law_named(name), dynamics, example)
        _loops[key] = partial(refusal, loop)
        if twin(loop) is loop:
            _loops[key] = loop
            warnings.warn(f"{WITHOUT_NUMBA}: runs take a hundred times as long", stacklevel=2)
    return _loops[key]
