"""Gains by experiment: a relay, a search over whole runs, and one over the draws of a study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from trunk_msgs_util.parameters.declarations import Value

from ..errors import PlanError, StudyError, did_you_mean
from ..plans.plan import make_plan
from ._paths import AnyPath
from ._plan import Plan
from ._study import Study
from ._values import names_of

if TYPE_CHECKING:
    from ..study.learning import DrawnRuns


@dataclass(frozen=True)
class Relay:
    """What a relay experiment found. Made by `relay`.

    ``overrides``: Table 1's PID gains for `plan`. ``ku`` [N m/rad] and ``tu`` [s]: ultimate gain and period,
    measured with the relay, whose oscillation has ``amplitude`` [rad]. ``exact_ku``, ``exact_tu``: where pure
    P loses stability by Routh's criterion; the describing function behind ``ku`` is an approximation.
    """

    overrides: dict[str, Value]
    ku: float
    tu: float
    amplitude: float
    exact_ku: float
    exact_tu: float


@dataclass(frozen=True)
class Optimum:
    """The best parameters of a search. Made by `optimise`.

    ``overrides``: for `plan`. ``before``, ``after``: the mean of the metric over the plans, in its unit, with
    the plans' own parameters and with these. ``runs``: how many runs it took.
    """

    overrides: dict[str, Value]
    before: float
    after: float
    runs: int


@dataclass(frozen=True)
class DrawsOutcome:
    """How a controller does on some draws. Made by `learn`.

    ``fell`` of ``runs`` fell, a ``share`` with the bounds ``low`` and ``high`` of Wilson's 95 % interval;
    ``mean``: of the metric over the runs that stood, in its unit; NaN if none did.
    """

    controller: str
    fell: int
    runs: int
    share: float
    low: float
    high: float
    mean: float


@dataclass(frozen=True)
class Learned:
    """Parameters searched on a study's draws, and judged on others. Made by `learn`.

    ``overrides``: for `plan`. ``before``, ``after``: the cost on the searched draws, in the metric's unit; a
    fall counts as ``fall_costs``. ``runs``: how many runs the search took. ``searched``: before and after, on
    the draws of the search; ``held_out``: before, after and the study's other controllers, on draws that the
    search did not see.
    """

    overrides: dict[str, Value]
    before: float
    after: float
    fall_costs: float
    runs: int
    searched: tuple[DrawsOutcome, ...]
    held_out: tuple[DrawsOutcome, ...]


def relay(
    lag: float, damping: float, *, amplitude: float = 1.0, params: AnyPath | Sequence[AnyPath] = ()
) -> Relay:
    """Return ultimate gain and period by a relay experiment, and Table 1's PID, as `trunk tune relay` does.

    ``lag``: time constant of the actuator in s; ``damping``: of the joint in N m s/rad. The plant itself has
    neither, and thus no ultimate gain. ``amplitude``: of the relay in N m. ``params``: parameter files with
    the plant, by path or name; later ones win.

    Raises PlanError for numbers out of range, and where no ultimate gain exists.
    """
    from ..tuning.linear import linearise
    from ..tuning.methods import relay, ziegler_nichols

    for name, number, low, high in (
        ("lag", lag, 0.0, 1e3),
        ("damping", damping, 0.0, 1e9),
        ("amplitude", amplitude, 1e-6, 1e6),
    ):
        if not (isinstance(number, int | float) and low <= number <= high):
            raise PlanError(
                f"relay: {name} {number!r}: a number from {low:g} to {high:g} is needed"
            )
    plan = make_plan("fig6", "pid", ["profile_practical", *names_of(params, "params")], (), {})
    plant = linearise(plan.simulator.body)
    limit = relay(plant._replace(c=damping * plant.b, lag=float(lag)), float(amplitude))
    gains = ziegler_nichols(limit.gain, limit.period)
    return Relay({f"pid.gains.{name}": getattr(gains, name) for name in "pid"}, *limit)


def optimise(
    *plans: Plan,
    metric: str = "itae",
    generations: int = 20,
    population: int = 5,
    seed: int = 1,
    progress: Callable[[int, float], None] | None = None,
) -> Optimum:
    """Search a controller's parameters for the smallest mean of a metric over plans: `trunk tune optimise`.

    By differential evolution on whole runs, ``population`` candidates per number searched in each generation;
    the same ``seed`` gives the same result. For ``pid`` it searches the gains; for ``fuzzy_pid`` the ranges
    of the gains, both universes and the rule tables, symmetric in e and its rate; for any other controller
    all of its own numbers. ``metric``: of `Metrics`, by magnitude, except the angles' extremes.
    ``progress``: called with the generation and the least mean so far.

    Raises PlanError if there is no plan, for plans of different controllers or with swaps, and for numbers
    out of range.
    """
    from ..tuning.search import search

    if not plans or not all(isinstance(plan, Plan) for plan in plans):
        raise PlanError(f"optimise: {plans!r}: give one or more of what trunk.plan(...) returns")
    acting = {plan.controllers for plan in plans}
    if len(acting) > 1 or len(plans[0].controllers) > 1:
        names = ", ".join(sorted({name for names in acting for name in names}))
        raise PlanError(
            f"optimise: the plans' controllers are {names}: give plans of one controller"
        )
    _check("optimise", metric, generations, population, seed)
    optimum = search(
        [plan._plan for plan in plans], metric, generations, population, seed, progress or _quiet
    )
    values = _overrides(plans[0].controllers[0], optimum.values)
    return Optimum(values, optimum.start_cost, optimum.cost, optimum.runs)


def learn(
    study: Study,
    controller: str,
    *,
    metric: str = "itae",
    generations: int = 20,
    population: int | None = None,
    seed: int = 1,
    held_out_seed: int | None = None,
    jobs: int = 1,
    progress: Callable[[int, float], None] | None = None,
) -> Learned:
    """Search a controller's parameters on a study's draws, and judge them on others: `tune optimise --study`.

    ``controller``: one of the study's. What is searched, ``metric``, ``seed`` and ``progress``: as for
    `optimise`; by CMA-ES. The cost is the metric's mean over the draws, in which a fall counts as ten times
    the mean of the parameters at the start. ``population``: candidates; None: as CMA-ES recommends.
    ``held_out_seed``: of the draws by which the result is judged; None: the study's + 1. ``jobs``: how many
    processes; with more than one, a script needs ``if __name__ == "__main__":`` around the call.

    Raises StudyError for a controller that is not in the study, or falls in each of its draws, and for
    held-out draws that are those of the search; PlanError for numbers out of range.
    """
    from ..study.learning import learn

    if not isinstance(study, Study):
        raise StudyError(f"learn: {study!r} is not a study: give what trunk.study(...) returns")
    _check("learn", metric, generations, population, seed)
    _check_whole("learn", "jobs", jobs, 1, 1024)
    other = study._study.seed + 1 if held_out_seed is None else held_out_seed
    _check_whole("learn", "held_out_seed", other, 0, 2**31 - 1)
    learned = learn(
        study._study, controller, metric, generations, population, seed, other, jobs,
        progress or _quiet,
    )  # fmt: skip
    return Learned(
        _overrides(learned.plan.controller_name, learned.values),
        learned.before,
        learned.after,
        learned.fall,
        learned.runs,
        tuple(map(_outcome, learned.trained)),
        tuple(map(_outcome, learned.held_out)),
    )


def _quiet(generation: int, least: float) -> None:
    """Tell nobody."""


def _overrides(controller: str, values: dict[str, Value]) -> dict[str, Value]:
    return {f"{controller}.{name}": value for name, value in values.items()}


def _outcome(drawn: DrawnRuns) -> DrawsOutcome:
    return DrawsOutcome(drawn.label, drawn.fell, len(drawn.metric), *drawn.share, drawn.mean)


def _check(verb: str, metric: str, generations: int, population: int | None, seed: int) -> None:
    """Raise PlanError for what a search does not take."""
    from ..analysis.metrics import JUDGED

    if metric not in JUDGED:
        hint = did_you_mean(str(metric), JUDGED)
        raise PlanError(f"{verb}: metric {metric!r}: one of {', '.join(JUDGED)}{hint}")
    _check_whole(verb, "generations", generations, 1, 100_000)
    if population is not None:
        _check_whole(verb, "population", population, 2, 1000)
    _check_whole(verb, "seed", seed, 0, 2**32 - 1)


def _check_whole(verb: str, name: str, number: object, low: int, high: int) -> None:
    if isinstance(number, bool) or not isinstance(number, int) or not low <= number <= high:
        raise PlanError(f"{verb}: {name} {number!r}: a whole number from {low} to {high} is needed")
