"""Parameters searched on the draws of a study, and judged on draws that the search did not see."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from math import inf, nan
from typing import NamedTuple

import cma
import numpy as np

from trunk_msgs_util.parameters.declarations import Value, changed
from trunk_msgs_util.recording.joint_table import Floats

from ..batch.block import RunSummary, summaries
from ..batch.workers import worker_pool
from ..errors import RunError, StudyError
from ..plans.plan import RunPlan
from ..tuning.search import Space, space_of
from .compare import DrawnRuns
from .rows import Bases, make_bases, plan_of, rows_of, shared_batch
from .study import StudySpec, design

_SPREAD = 0.25  # of the search's first candidates, in widths of the space
_INSIDE = 0.02, 0.98
FALL = 10.0  # times the start's mean of the metric: what a fall costs
Values = dict[str, Value]
Evaluate = Callable[[Sequence[Values]], list[Floats]]
Progress = Callable[[int, float], None]


class Draws(NamedTuple):
    """The runs of a study; all that a worker needs: it reads no files."""

    study: StudySpec
    bases: Bases

    def __hash__(self) -> int:
        return hash(self.study)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Draws) and self.study == other.study


@lru_cache(maxsize=8)
def _plans(draws: Draws, label: str) -> tuple[RunPlan, ...]:
    """Return a contender's plans, in the order of the draws."""
    study, bases = draws
    rows = rows_of(design(study, 0, study.total))
    return tuple(plan_of(study, bases, row) for row in rows if row["controller"] == label)


class Learned(NamedTuple):
    """Parameters searched on a study's draws, and judged on others. Made by `learn`.

    ``before``, ``after``: the cost on the searched draws, in the metric's unit; a fall counts as
    ``fall_costs``. ``runs``: how many runs the search took. ``searched``: before and after, on the draws of
    the search; ``held_out``: before, after and the study's other controllers, on draws that the search did
    not see.
    """

    values: Values
    plan: RunPlan  # of the contender, with no draw in it
    before: float
    after: float
    fall_costs: float
    runs: int
    searched: tuple[DrawnRuns, DrawnRuns]
    held_out: tuple[DrawnRuns, ...]

    @property
    def overrides(self) -> Values:
        """The parameters, for a plan."""
        return {f"{self.plan.controller_name}.{name}": v for name, v in self.values.items()}


def learn(
    study: StudySpec,
    controller: str,
    metric: str,
    generations: int,
    population: int | None,
    seed: int,
    held_out_seed: int,
    jobs: int,
    progress: Progress,
) -> Learned:
    """Search a contender's parameters for the least cost on a study's draws, and judge it on those of a seed.

    The cost is the metric's mean over the draws; a fall counts as `FALL` times the start's mean. By CMA-ES
    (N. Hansen), seeded: the same seed gives the same result, whatever the number of ``jobs``. Raises
    StudyError for a contender that is not in the study, and for a seed whose draws are those of the search.
    """
    label = _label(study, controller)
    if held_out_seed == study.seed or study.runs < 2:
        raise StudyError(
            f"{study.source}: the held-out draws must be others: give a study with runs of 2 or more, and "
            f"another seed than {study.seed}"
        )
    draws = Draws(study, make_bases(study))
    plan = next(base for (name, _), base in draws.bases.items() if name == label)
    space = space_of(plan.controller_name, plan.controller)
    start = DrawnRuns(label, outcome(draws, label, {}, metric))
    if np.isnan(start.mean):
        raise StudyError(
            f"{study.source}: {label} falls in each of its {study.runs} draws: start from other parameters"
        )
    fall = FALL * start.mean
    with crew(draws, label, metric, jobs) as evaluate:
        values, after, runs = _searched(
            space, evaluate, fall, generations, population, seed, progress
        )
    before = cost(start.metric, fall)
    if before <= after:
        values, after = {}, before
    others = Draws(replace(study, seed=held_out_seed), draws.bases)
    new = f"{label}, learned"
    held_out = [
        DrawnRuns(label, outcome(others, label, {}, metric)),
        DrawnRuns(new, outcome(others, label, values, metric)),
        *(
            DrawnRuns(c.label, outcome(others, c.label, {}, metric))
            for c in study.contenders
            if c.label != label
        ),
    ]
    searched = start, DrawnRuns(new, outcome(draws, label, values, metric))
    count = len(start.metric)
    return Learned(
        values, plan, before, after, fall, runs * count + count, searched, tuple(held_out)
    )


def _label(study: StudySpec, controller: str) -> str:
    for contender in study.contenders:
        if controller in (contender.label, contender.node):
            return contender.label
    known = ", ".join(contender.label for contender in study.contenders)
    raise StudyError(f"{study.source}: no controller {controller!r} in it: it has {known}")


def _searched(
    space: Space,
    evaluate: Evaluate,
    fall: float,
    generations: int,
    population: int | None,
    seed: int,
    progress: Progress,
) -> tuple[Values, float, int]:
    """Return the best values, their cost, and the number of candidates."""
    low, high = np.array(space.bounds).T
    start = np.clip((np.array(space.start) - low) / (high - low), *_INSIDE)
    strategy = cma.CMAEvolutionStrategy(
        start,
        _SPREAD,
        # Its seed 0 is the clock; the count of candidates is its own unless given.
        {"bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9, "popsize": population or None},
    )
    best: tuple[float, Values] = (inf, {})
    count = 0
    for generation in range(1, generations + 1):
        points = strategy.ask()
        candidates = [space.values(low + (high - low) * np.clip(x, 0.0, 1.0)) for x in points]
        costs = [cost(metric, fall) for metric in evaluate(candidates)]
        strategy.tell(points, costs)
        count += len(points)
        least = int(np.argmin(costs))
        if costs[least] < best[0]:
            best = costs[least], candidates[least]
        progress(generation, best[0])
    return best[1], best[0], count


def cost(metric: Floats, fall: float) -> float:
    """Return the mean, each fall counted as ``fall``."""
    return float(np.where(np.isnan(metric), fall, metric).mean())


def outcome(draws: Draws, label: str, values: Values, metric: str) -> Floats:
    """Return a contender's metric in each run, with some parameters changed. Raises ParameterError."""
    plans = _plans(draws, label)
    if values:
        configs = {c: changed(c, values) for c in {p.controller for p in plans}}
        plans = tuple(plan.with_controller(configs[plan.controller]) for plan in plans)
    return np.array([_metric(summary, metric) for summary in summaries(plans, shared_batch())])


def _metric(summary: RunSummary, name: str) -> float:
    metrics = summary.metrics
    if metrics is None or summary.fell:
        return nan
    value = getattr(metrics, name)
    return nan if value in (None, inf) else abs(float(value))


@contextmanager
def crew(draws: Draws, label: str, metric: str, jobs: int) -> Iterator[Evaluate]:
    """Yield a function that evaluates candidates in worker processes, each over all draws in lanes.

    One worker is this process.
    """
    if jobs == 1:
        yield lambda candidates: [outcome(draws, label, v, metric) for v in candidates]
        return
    pool = worker_pool(jobs)

    def evaluate(candidates: Sequence[Values]) -> list[Floats]:
        futures = [pool.submit(outcome, draws, label, v, metric) for v in candidates]
        try:
            return [future.result() for future in futures]
        except BrokenProcessPool:
            raise RunError("a worker process died: is there enough memory?") from None

    try:
        yield evaluate
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
