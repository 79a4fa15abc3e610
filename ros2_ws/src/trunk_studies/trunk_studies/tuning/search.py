"""Searches gains, or fuzzy rules and ranges, by CMA-ES on whole simulated runs, seeded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from itertools import repeat
from math import ceil, copysign, inf, log10, nan
from operator import itemgetter
from typing import Any, NamedTuple

import cma
import numpy as np

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.law import ControllerConfig
from trunk_control.rule_tables import Axes
from trunk_core.arrays import Floats
from trunk_core.errors import PlanError, RunError
from trunk_core.parameters.declarations import Value, changed, declarations, value_of, values_of
from trunk_runs.plan import RunPlan

from ..batch.block import RunSummary, summaries, wrong_duration
from ..batch.workers import worker_pool

FALL = 10.0  # times the start's mean of the metric: what a fall costs
_SPREAD = 0.25  # of the search's first candidates, in widths of the space
_INSIDE = 0.02, 0.98
# Runs that a process is given at a time: they fill lanes, and fewer are not worth another process.
_TOGETHER = 100

Values = dict[str, Value]


class Optimum(NamedTuple):
    """The best parameters of a search. Made by `optimise`.

    ``before``, ``after``: the mean of the metric over the plans, in its unit, with the plans' own parameters
    and with these; a fall counts as ``fall_costs``. ``runs``: how many runs it took.
    """

    controller: str
    values: Values
    before: float
    after: float
    runs: int
    fall_costs: float

    @property
    def overrides(self) -> Values:
        """The parameters, for a plan."""
        return {f"{self.controller}.{name}": value for name, value in self.values.items()}


class Space(NamedTuple):
    """The search space: bounds of a vector, where a search starts in it, and its meaning."""

    bounds: list[tuple[float, float]]
    start: list[float]
    values: Callable[[Floats], dict[str, Value]]


def _powers(
    names: Sequence[str], exponents: Floats, signs: Iterable[float] = repeat(1.0)
) -> dict[str, Value]:
    """Return numbers as powers of ten with their signs."""
    return {name: float(s * 10.0**x) for name, x, s in zip(names, exponents, signs, strict=False)}


def gains_space(config: Any) -> Space:
    """Return the gains p, i, d from a tenth to ten times the current ones, as powers of ten."""
    names = ("gains.p", "gains.i", "gains.d")
    start = [log10(max(value_of(config, name), 1e-3)) for name in names]
    return Space([(s - 1.0, s + 1.0) for s in start], start, partial(_powers, names))


def own_space(config: Any) -> Space:
    """Return a law's own numbers but zeros, from a tenth to ten times the current ones, within their bounds.

    Raises PlanError for a law without numbers that may change.
    """
    shared, own = declarations(ControllerConfig), declarations(type(config))
    names = [
        name
        for name, now in values_of(config).items()
        if name not in shared and not own[name].fixed and isinstance(now, float) and now != 0.0
    ]
    if not names:
        raise PlanError(
            f"{type(config).__name__} has no number other than 0 that may change: there is nothing to search"
        )
    signs = [copysign(1.0, value_of(config, name)) for name in names]
    start = [log10(abs(value_of(config, name))) for name in names]
    bounds = []
    for name, middle, sign in zip(names, start, signs, strict=True):
        declared = own[name]
        if sign < 0.0:
            bounds.append((middle - 1.0, middle + 1.0))
            continue
        lowest = declared.above if declared.minimum is None else declared.minimum
        low = log10(lowest * 1.001) if lowest is not None and lowest > 0.0 else -inf
        high = log10(declared.maximum) if declared.maximum is not None else inf
        bounds.append((max(middle - 1.0, low), min(middle + 1.0, high)))
    return Space(bounds, start, partial(_powers, names, signs=signs))


def space_of(controller: str, config: Any) -> Space:
    """Return the search space of a controller. Raises PlanError if there is none."""
    if isinstance(config, FuzzyPidConfig):
        return fuzzy_space(config)
    return gains_space(config) if controller == "pid" else own_space(config)


def fuzzy_space(config: FuzzyPidConfig) -> Space:
    """Return a law's own numbers, such as ranges and universes, and its tables, symmetric in e and e_dot.

    A quarter of each table defines it; its cells are the labels. Raises PlanError for a table with numbers in
    its cells.
    """
    names: tuple[str, ...] = ("gains.p_min", "gains.p_max", "gains.d_min", "gains.d_max")
    names += ("fuzzy.error_range", "fuzzy.rate_range")
    start = [log10(value_of(config, name)) for name in names]
    bounds = [(s - 0.5, s + 0.5) for s in start]
    rows, columns = ((len(labels) + 1) // 2 for labels in config.axes)
    labels_of: dict[str, tuple[str, ...]] = {}
    for table in config.tables:
        name, labels = f"rules.{table.name}", tuple(table.centers)
        labels_of[name] = labels
        quarter = [cell for row in table.cells[:rows] for cell in row[:columns]]
        numbers = [cell for cell in quarter if cell not in labels]
        if numbers:
            raise PlanError(
                f"{name}: the cell {numbers[0]} is a number: labels are searched: {', '.join(labels)}"
            )
        start += [float(labels.index(cell)) for cell in quarter]
        bounds += [(0.0, len(labels) - 1.0)] * len(quarter)

    def values(x: Floats) -> dict[str, Value]:
        parameters = _powers(names, x[: len(names)])
        for low, high in (("gains.p_min", "gains.p_max"), ("gains.d_min", "gains.d_max")):
            pair: list[Any] = sorted([parameters[low], parameters[high]])
            parameters[low], parameters[high] = pair
        cells = x[len(names) :].round().astype(int).reshape(len(labels_of), rows, columns)
        for (name, labels), quarter in zip(labels_of.items(), cells.tolist(), strict=True):
            parameters[name] = _mirrored([[labels[c] for c in row] for row in quarter], config.axes)
        return parameters

    return Space(bounds, start, values)


def _mirrored(quarter: list[list[str]], axes: Axes) -> tuple[str, ...]:
    """Return the table of which this is the first quarter; a middle row or column is there once."""
    width, height = len(axes.rate), len(axes.error)
    rows = [" ".join(row + row[: width // 2][::-1]) for row in quarter]
    return tuple(rows + rows[: height // 2][::-1])


def search(
    plans: Sequence[RunPlan],
    metric: str,
    generations: int,
    population: int | None,
    seed: int,
    jobs: int,
    progress: Callable[[int, float], None],
) -> Optimum:
    """Return the parameters of the plans' controller with the least cost.

    The cost is the metric's mean over the plans, in which a fall, as a run without the metric, counts as
    `FALL` times the start's mean. By CMA-ES (N. Hansen), seeded: the same seed gives the same result,
    whatever the number of ``jobs``. ``population``: candidates in a generation; None: as CMA-ES recommends.
    ``progress`` is called with the generation and the least cost so far.

    Raises PlanError for a plan without an end or too long a one, and for a controller that falls in each.
    """
    for plan in plans:
        wrong = wrong_duration(plan.simulator.duration, plan.simulator.update_rate)
        if wrong:
            raise PlanError(f"{plan.scenario}: {wrong}")
    controller = plans[0].controller_name
    space = space_of(controller, plans[0].controller)
    start = metrics_of(plans, metric, [{}])[0]
    if np.isnan(start).all():
        raise PlanError(
            f"{controller} falls in each of {len(plans)} runs, or has no {metric} in them: start from "
            "other parameters"
        )
    fall = FALL * float(np.nanmean(start))
    if fall == 0.0:
        raise PlanError(
            f"{metric} is 0 in each run of {controller} that stands, and nothing is smaller: choose another"
        )
    low, high = np.array(space.bounds).T
    inside = np.clip((np.array(space.start) - low) / (high - low), *_INSIDE)
    strategy = cma.CMAEvolutionStrategy(
        np.resize(inside, max(len(inside), 2)),  # of a single number, another one moves nothing
        _SPREAD,
        # Its seed 0 is the clock; the count of candidates is its own unless given.
        {"bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9, "popsize": population},
    )
    before, tried = cost(start, fall), 1
    best: tuple[float, Values] = before, {}
    size = max(_TOGETHER // len(plans), 1)
    with _crew(min(jobs, ceil(strategy.popsize / size))) as spread:
        for generation in range(1, generations + 1):
            points = strategy.ask()
            candidates = [
                space.values(low + (high - low) * np.clip(x[: len(low)], 0.0, 1.0)) for x in points
            ]
            parts = [candidates[i : i + size] for i in range(0, len(candidates), size)]
            found = np.concatenate(list(spread(partial(metrics_of, plans, metric), parts)))
            costs = [cost(metrics, fall) for metrics in found]
            strategy.tell(points, costs)
            tried += len(points)
            best = min(best, *zip(costs, candidates, strict=True), key=itemgetter(0))
            progress(generation, best[0])
    return Optimum(controller, best[1], before, best[0], tried * len(plans), fall)


def cost(metrics: Floats, fall: float) -> float:
    """Return the mean, each fall counted as ``fall``."""
    return float(np.where(np.isnan(metrics), fall, metrics).mean())


def metrics_of(plans: Sequence[RunPlan], metric: str, candidates: Sequence[Values]) -> Floats:
    """Return a metric's magnitude in each plan's run with each candidate's parameters [candidates, plans].

    NaN where the trunk falls, or there is no such metric. Raises ParameterError.
    """
    configs = dict.fromkeys(plan.controller for plan in plans)
    tried = []
    for values in candidates:
        new = {config: changed(config, values) if values else config for config in configs}
        tried += [plan.with_controller(new[plan.controller]) for plan in plans]
    found = [_metric(summary, metric) for summary in summaries(tried)]
    return np.reshape(found, (len(candidates), len(plans)))


def _metric(summary: RunSummary, name: str) -> float:
    if summary.metrics is None or summary.fell:
        return nan
    value = getattr(summary.metrics, name)
    return nan if value in (None, inf) else abs(float(value))


@contextmanager
def _crew(jobs: int) -> Iterator[Callable[..., Iterator[Floats]]]:
    """Yield a ``map`` over worker processes; one worker is this process."""
    if jobs == 1:
        yield map
        return
    pool = worker_pool(jobs)
    try:
        yield pool.map
    except BrokenProcessPool:
        raise RunError("a worker process died: is there enough memory?") from None
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
