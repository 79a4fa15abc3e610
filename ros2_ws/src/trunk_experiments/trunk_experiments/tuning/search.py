"""Searches gains, or fuzzy rules and ranges, by seeded differential evolution on whole simulated runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import count
from math import inf, log10
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from trunk_control.controller_config import ControllerConfig
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.rule_tables import Axes
from trunk_msgs_util.parameters.declarations import (
    Value,
    changed,
    declarations,
    value_of,
    values_of,
)
from trunk_msgs_util.recording.joint_table import Floats

from ..batch.block import summary_of, wrong_duration
from ..batch.compiled_run import Batch
from ..errors import PlanError
from ..plans.plan import RunPlan

FAILED = 1e9  # cost of a run that falls, diverges or lacks the metric


class Optimum(NamedTuple):
    """The best parameters of a search. Made by `optimise`.

    ``before``, ``after``: the mean of the metric over the plans, in its unit, with the plans' own parameters
    and with these. ``runs``: how many runs it took.
    """

    controller: str
    values: dict[str, Value]
    before: float
    after: float
    runs: int

    @property
    def overrides(self) -> dict[str, Value]:
        """The parameters, for a plan."""
        return {f"{self.controller}.{name}": value for name, value in self.values.items()}


class Space(NamedTuple):
    """The search space: bounds of a vector, which entries are integers, and its meaning."""

    bounds: list[tuple[float, float]]
    integrality: list[bool]
    start: list[float]
    values: Callable[[Floats], dict[str, Value]]


def _powers(names: Sequence[str], exponents: Floats) -> dict[str, Value]:
    """Return numbers as powers of ten."""
    return {name: float(10.0**x) for name, x in zip(names, exponents, strict=True)}


def gains_space(config: Any) -> Space:
    """Return the gains p, i, d from a tenth to ten times the current ones, as powers of ten."""
    names = ("gains.p", "gains.i", "gains.d")
    start = [log10(max(value_of(config, name), 1e-3)) for name in names]
    return Space([(s - 1.0, s + 1.0) for s in start], [False] * 3, start, partial(_powers, names))


def own_space(config: Any) -> Space:
    """Return a law's own numbers, from a tenth to ten times the current ones, within their bounds.

    Raises PlanError for a law without numbers that may change.
    """
    shared, own = declarations(ControllerConfig), declarations(type(config))
    names = [
        name
        for name, now in values_of(config).items()
        if name not in shared and not own[name].fixed and isinstance(now, float) and now > 0.0
    ]
    if not names:
        raise PlanError(
            f"{type(config).__name__} has no number above 0 that may change: there is nothing to search"
        )
    start = [log10(value_of(config, name)) for name in names]
    bounds = []
    for name, middle in zip(names, start, strict=True):
        declared = own[name]
        lowest = declared.above if declared.minimum is None else declared.minimum
        low = log10(lowest * 1.001) if lowest is not None and lowest > 0.0 else -inf
        high = log10(declared.maximum) if declared.maximum is not None else inf
        bounds.append((max(middle - 1.0, low), min(middle + 1.0, high)))
    return Space(bounds, [False] * len(names), start, partial(_powers, names))


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

    integers = len(start) - len(names)
    return Space(bounds, [False] * len(names) + [True] * integers, start, values)


def _mirrored(quarter: list[list[str]], axes: Axes) -> tuple[str, ...]:
    """Return the table of which this is the first quarter; a middle row or column is there once."""
    width, height = len(axes.rate), len(axes.error)
    rows = [" ".join(row + row[: width // 2][::-1]) for row in quarter]
    return tuple(rows + rows[: height // 2][::-1])


def search(
    plans: Sequence[RunPlan],
    metric: str,
    generations: int,
    population: int,
    seed: int,
    progress: Callable[[int, float], None],
) -> Optimum:
    """Return the parameters of the plans' controller with the smallest mean metric over the plans.

    The same seed gives the same result. A fall costs as much as a divergence. ``progress`` is called with the
    generation and the best cost so far. Raises PlanError for a plan without an end, or too long a one.
    """
    for plan in plans:
        wrong = wrong_duration(plan.simulator.duration, plan.simulator.update_rate)
        if wrong:
            raise PlanError(f"{plan.scenario}: {wrong}")
    space = space_of(plans[0].controller_name, plans[0].controller)
    batch = Batch()
    runs, least = 0, inf

    def cost(x: Floats) -> float:
        nonlocal runs, least
        values = space.values(x)
        total = 0.0
        for plan in plans:
            runs += 1
            tried = changed(plan.controller, values)
            outcome = summary_of(plan.with_controller(tried), batch)
            value = getattr(outcome.metrics, metric) if outcome.stood else None
            total += FAILED if value in (None, inf) else abs(float(value))
        least = min(least, total / len(plans))
        return total / len(plans)

    generations_done = count(1)

    def heard(x: Floats, convergence: float = 0.0) -> None:
        progress(next(generations_done), least)

    start = np.array(space.start)
    start_cost = cost(start)
    optimum = differential_evolution(
        cost,
        space.bounds,
        maxiter=generations,
        popsize=population,
        seed=seed,
        x0=start,
        integrality=space.integrality,
        polish=False,
        tol=0.0,
        callback=heard,
    )
    best = start if start_cost <= optimum.fun else optimum.x
    after = min(start_cost, float(optimum.fun))
    return Optimum(plans[0].controller_name, space.values(best), start_cost, after, runs)
