"""Parameters searched on the draws of a study, and judged on draws that the search did not see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from trunk_core.errors import StudyError
from trunk_runs.plan import RunPlan

from .rows import Bases, make_bases, plan_of, rows_of
from .statistics import DrawnRuns
from .study import StudySpec, design
from .tuning.search import Values, metrics_of, search


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
    progress: Callable[[int, float], None],
) -> Learned:
    """Search a contender's parameters on a study's draws, as `search` does, and judge it on those of a seed.

    Raises StudyError for a contender that is not in the study, and for a seed whose draws are those of the
    search; PlanError as `search` does.
    """
    label = _label(study, controller)
    if held_out_seed == study.seed or study.runs < 2:
        raise StudyError(
            f"{study.source}: the held-out draws must be others: give a study with runs of 2 or more, and "
            f"another seed than {study.seed}"
        )
    bases = make_bases(study)
    drawn, others = (_plans(spec, bases) for spec in (study, replace(study, seed=held_out_seed)))
    plan = next(base for (name, _), base in bases.items() if name == label)
    optimum = search(drawn[label], metric, generations, population, seed, jobs, progress)

    def runs(plans: Sequence[RunPlan], name: str, values: Values) -> DrawnRuns:
        return DrawnRuns(name, metrics_of(plans, metric, [values])[0])

    def pair(plans: Sequence[RunPlan]) -> tuple[DrawnRuns, DrawnRuns]:
        return runs(plans, label, {}), runs(plans, f"{label}, learned", optimum.values)

    rest = [runs(plans, name, {}) for name, plans in others.items() if name != label]
    return Learned(
        optimum.values,
        plan,
        optimum.before,
        optimum.after,
        optimum.fall_costs,
        optimum.runs,
        pair(drawn[label]),
        (*pair(others[label]), *rest),
    )


def _plans(study: StudySpec, bases: Bases) -> dict[str, list[RunPlan]]:
    """Return each contender's plans, in the order of the draws."""
    plans: dict[str, list[RunPlan]] = {c.label: [] for c in study.contenders}
    for row in rows_of(design(study, 0, study.total)):
        plans[str(row["controller"])].append(plan_of(study, bases, row))
    return plans


def _label(study: StudySpec, controller: str) -> str:
    for contender in study.contenders:
        if controller in (contender.label, contender.node):
            return contender.label
    known = ", ".join(contender.label for contender in study.contenders)
    raise StudyError(f"{study.source}: no controller {controller!r} in it: it has {known}")
