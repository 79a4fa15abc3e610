"""The greatest value of a parameter that a controller withstands; the shares of random trunks that do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from trunk_msgs_util.parameters.declarations import ParameterError

from ..batch.block import RunSummary, summaries
from ..batch.columns import LANES
from ..batch.compiled_run import Batch
from ..errors import PlanError, StudyError
from ..plans.plan import RunPlan
from .bases import make_bases, plan_of
from .design import design
from .intervals import Estimate, wilson
from .results import FALLEN_DEG
from .study import StudySpec, Target, Variable

PlanAt = Callable[[float], RunPlan]
Progress = Callable[[int], None]  # takes the number of runs that were made


class Bracket(NamedTuple):
    """Where a controller falls, in the parameter's unit."""

    stands: float | None  # up to here every tried value stands; None: the first one falls
    falls: float | None  # the smallest tried value beyond it, which falls; None: none does
    stands_again: tuple[float, ...]  # tried values beyond that, which stand
    runs: int

    def as_values(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        return self._asdict()


def stood(run: RunSummary) -> bool:
    """Return True for a run whose trunk stayed within 90 degrees, all states finite."""
    m = run.metrics
    return m is not None and max(m.theta_max_deg, -m.theta_min_deg) < FALLEN_DEG


def find_limit(
    plan_at: PlanAt, low: float, high: float, within: float, progress: Progress = lambda runs: None
) -> Bracket:
    """Return the greatest value between ``low`` and ``high`` that stands, to ``within``.

    Each round tries as many values as there are lanes: first the whole range, then between the last that
    stands and the first that falls. A fall need not be final: a stronger pulse may throw the trunk through to
    where it is caught, so what stands beyond is returned, too. Raises PlanError for a value that is refused.
    """
    batch = Batch()
    tried: dict[float, bool] = {}
    values = np.linspace(low, high, LANES).tolist()
    while True:
        for value, run in zip(values, summaries(map(plan_at, values), batch), strict=True):
            if run.refused:
                raise PlanError(f"{value:g}: {run.refused}")
            tried[value] = stood(run)
        progress(len(tried))
        falls = next((value for value in sorted(tried) if not tried[value]), None)
        stands = max((value for value in tried if falls is None or value < falls), default=None)
        if falls is None or stands is None or falls - stands <= within:
            again = sorted(
                v for v, good in tried.items() if good and falls is not None and v > falls
            )
            return Bracket(stands, falls, tuple(again), len(tried))
        values = np.linspace(stands, falls, LANES + 2)[1:-1].tolist()


class Survival(NamedTuple):
    """The share of a study's runs that stand each value of a parameter, for one controller."""

    values: tuple[float, ...]
    shares: tuple[Estimate, ...]  # with Wilson's interval
    runs: int  # at each value

    def half(self) -> float | None:
        """Return the value at which half of the runs fall, between two tried ones; None: not reached."""
        shares = [estimate.value for estimate in self.shares]
        for k in range(1, len(shares)):
            if shares[k] < 0.5 <= shares[k - 1]:
                part = (shares[k - 1] - 0.5) / (shares[k - 1] - shares[k])
                return self.values[k - 1] + part * (self.values[k] - self.values[k - 1])
        return None


def survival(
    study: StudySpec,
    target: Target,
    values: Sequence[float],
    progress: Progress = lambda runs: None,
) -> Mapping[str, Survival]:
    """Return a survival curve for each controller of a study: every run of it, with each value.

    The study's draws are the same at every value. Raises StudyError if it varies the target itself, or if
    the parameter takes none of the values.
    """
    name = "limit"
    taken = [str(t) for v in study.variables for t in v.targets]
    if str(target) in taken:
        raise StudyError(f"{study.source}: it varies {target} itself: leave that out")
    varied = replace(
        study, variables=(*study.variables, Variable(name, (target,), "value", tuple(values)))
    )
    bases = make_bases(varied)
    counts: dict[str, dict[float, list[int]]] = {}
    batch = Batch()
    for first in range(0, varied.total, study.block):
        columns = design(varied, first, min(first + study.block, varied.total))
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        plans: list[tuple[dict[str, Any], RunPlan]] = []
        for row in rows:
            try:
                plans.append((row, plan_of(varied, bases, row)))
            except (ParameterError, PlanError) as error:
                raise StudyError(f"{study.source}: run {row['run']}: {error}") from None
        for (row, _), run in zip(plans, summaries((plan for _, plan in plans), batch), strict=True):
            if run.refused:
                raise StudyError(f"{study.source}: run {row['run']}: {run.refused}")
            count = counts.setdefault(row["controller"], {}).setdefault(row[name], [0, 0])
            count[0] += stood(run)
            count[1] += 1
        progress(len(rows))
    return {
        controller: Survival(
            tuple(of_value),
            tuple(wilson(good, of) for good, of in of_value.values()),
            max(of for _, of in of_value.values()),
        )
        for controller, of_value in counts.items()
    }
