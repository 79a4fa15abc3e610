"""Gains from a model and by experiment, why a controller commanded a torque, how large a parameter may be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from trunk_core.errors import PlanError, StudyError, did_you_mean
from trunk_runs.plan import make_plan

from ._run import Plan, Run, plan, run_of
from ._sweep import Study
from ._values import AnyPath, mapping_of, names_of

if TYPE_CHECKING:
    from trunk_core.parameters.declarations import Value
    from trunk_evidence.explanation import Explanation
    from trunk_studies.learning import Learned
    from trunk_studies.robustness import Limit
    from trunk_studies.tuning.methods import Relay
    from trunk_studies.tuning.search import Optimum


_LARGEST = {
    "lqr": ("integral", "angle", "speed", "torque"),
    "state_feedback": ("position", "angle", "velocity", "speed", "torque"),
}


def explain(run: Run | AnyPath, at: float) -> Explanation:
    """Return why the controller commanded its torque at ``at`` s, as `trunk explain` says it.

    Its attributes are ``controller``, ``reference``, ``measurement``, ``rate``, ``terms`` (P, I and D, gains,
    or a law's own), ``rules`` (those that fired), ``limits``, ``windup``, ``disturbance``, ``true_angle``,
    ``recorded`` and ``applied``, in SI units and radians; ``agrees`` is True if the recomputed command is the
    recorded one, bit by bit.

    Raises RecordingError for an instant outside the run, or if the run lacks what is needed.
    """
    from trunk_evidence.explanation import explain

    return explain(run_of(run)._recorded, float(at))


def tune(
    controller: str = "lqr",
    *,
    poles: Sequence[float] = (-12.0, -8.0, -2.0),
    largest: Mapping[str, float] = MappingProxyType({}),
    params: AnyPath | Sequence[AnyPath] = (),
    rate: float | None = None,
    discrete: bool = False,
) -> dict[str, Value]:
    """Return gains for the trunk linearised about the upright, as overrides for `plan`.

    ``controller``: ``lqr`` and ``state_feedback`` solve the Riccati equation, as `trunk tune lqr` does;
    ``pid`` and ``computed_torque`` place the ``poles``, in 1/s, two or three, as `trunk tune poles` does.
    ``largest``: for the first two, the largest acceptable ``angle`` [rad], ``speed`` [rad/s] and ``torque``
    [N m]; for ``lqr`` also ``integral`` [rad s], for ``state_feedback`` ``position`` [m] and ``velocity``
    [m/s] of the other coordinate; by default 6 degrees, 1, 5, 0.1, 0.3 and 1.
    ``params``: parameter files with the plant, by path or name; later ones win. ``rate``: in Hz.
    ``discrete``: for these two, solve the equation of the sampled trunk, its torque held over each period.

    Raises PlanError for any other controller or name, and where no gains hold the plant.
    """
    from trunk_studies.tuning.methods import RICCATI, pole_gains

    known = *RICCATI, "pid", "computed_torque"
    if controller not in known:
        raise PlanError(f"tune: controller {controller!r}: one of {', '.join(known)}")
    everywhere = {} if rate is None else {"update_rate": float(rate)}
    files = ["profile_practical", *names_of(params, "params")]
    loop = make_plan("fig6", controller, files, (), everywhere)
    if controller in RICCATI:
        given = mapping_of(largest, "largest", "{'torque': 5.0}")
        names = _LARGEST[controller]
        for name, value in given.items():
            if name not in names or not (isfinite(value) and value > 0.0):
                raise PlanError(
                    f"tune: largest {name!r} {value!r}: above 0, of {', '.join(names)}, is needed"
                )
        values = RICCATI[controller](loop, **given, discrete=discrete)
    else:
        values = pole_gains(loop, tuple(map(float, poles)))
    return {f"{controller}.{name}": value for name, value in values.items()}


def limit(
    scenario: AnyPath,
    vary: str,
    low: float,
    high: float,
    controller: str = "fuzzy_pid",
    *,
    params: AnyPath | Sequence[AnyPath] = (),
    overrides: Mapping[str, Any] = MappingProxyType({}),
    within: float = 1e-3,
) -> Limit:
    """Return how far a parameter may go with the trunk within ``simulator.fall.angle`` throughout: bisection.

    ``vary``: ``"NODE.PARAM"``, a number, tried from ``low``, which should stand, to ``high``, which may be
    smaller, in SI units and radians; ``within``: how exact, as a share of that range. The other arguments are
    those of `plan`.

    Raises PlanError for a value that is refused.
    """
    from trunk_studies.robustness import find_limit

    if not (isfinite(low) and isfinite(high) and low != high and 0.0 < within <= 1.0):
        raise PlanError(
            f"limit: low {low!r}, high {high!r}, within {within!r}: two ends are needed, within up to 1"
        )

    def at(value: float) -> Plan:
        return plan(scenario, controller, params=params, overrides={**overrides, vary: value})

    exact = within * abs(high - low)
    return find_limit(lambda value: at(value)._plan, low, high, exact)


def relay(
    lag: float, damping: float, *, amplitude: float = 1.0, params: AnyPath | Sequence[AnyPath] = ()
) -> Relay:
    """Return ultimate gain and period by a relay experiment, and Table 1's PID, as `trunk tune relay` does.

    ``lag``: time constant of the actuator in s; ``damping``: of the joint in N m s/rad. The plant itself has
    neither, and thus no ultimate gain. ``amplitude``: of the relay in N m. ``params``: parameter files with
    the plant, by path or name; later ones win.

    Raises PlanError for numbers out of range, and where no ultimate gain exists.
    """
    from trunk_studies.tuning.linear import linearise
    from trunk_studies.tuning.methods import relay

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
    plant = linearise(plan.simulator)
    return relay(plant._replace(c=damping * plant.b, lag=float(lag)), float(amplitude))


def optimise(
    *plans: Plan,
    metric: str = "itae",
    generations: int = 20,
    population: int | None = None,
    seed: int = 1,
    jobs: int = 1,
    progress: Callable[[int, float], None] | None = None,
) -> Optimum:
    """Search a controller's parameters for the smallest mean of a metric over plans: `trunk tune optimise`.

    By CMA-ES on whole runs, ``population`` candidates in each generation, None: as it recommends; the same
    ``seed`` gives the same result. A fall counts as ten times the mean of the parameters at the start. For
    ``pid`` it searches the gains; for ``fuzzy_pid`` the ranges of the gains, both universes and the rule
    tables, symmetric in e and its rate; for any other controller all of its own numbers. ``metric``: of
    `Metrics`, by magnitude, except the angles' extremes. ``jobs``: how many processes; with more than one, a
    script needs ``if __name__ == "__main__":`` around the call. ``progress``: called with the generation and
    the least cost so far.

    Raises PlanError if there is no plan, for plans of different controllers or with swaps, for a controller
    that falls in each, and for numbers out of range.
    """
    from trunk_studies.tuning.search import search

    if not plans or not all(isinstance(plan, Plan) for plan in plans):
        raise PlanError(f"optimise: {plans!r}: give one or more of what trunk.plan(...) returns")
    acting = {plan.controllers for plan in plans}
    if len(acting) > 1 or len(plans[0].controllers) > 1:
        names = ", ".join(sorted({name for names in acting for name in names}))
        raise PlanError(
            f"optimise: the plans' controllers are {names}: give plans of one controller"
        )
    _check("optimise", metric, generations, population, seed, jobs)
    return search(
        [plan._plan for plan in plans], metric, generations, population, seed, jobs,
        progress or _quiet,
    )  # fmt: skip


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

    ``controller``: one of the study's. ``held_out_seed``: of the draws by which the result is judged; None:
    the study's + 1. The search, and all other arguments: as for `optimise`.

    Raises StudyError for a controller that is not in the study, and for held-out draws that are those of the
    search; PlanError for a controller that falls in each draw, and for numbers out of range.
    """
    from trunk_studies.learning import learn

    if not isinstance(study, Study):
        raise StudyError(f"learn: {study!r} is not a study: give what trunk.study(...) returns")
    _check("learn", metric, generations, population, seed, jobs)
    other = study._study.seed + 1 if held_out_seed is None else held_out_seed
    _check_whole("learn", "held_out_seed", other, 0, 2**31 - 1)
    return learn(
        study._study, controller, metric, generations, population, seed, other, jobs,
        progress or _quiet,
    )  # fmt: skip


def _quiet(generation: int, least: float) -> None:
    """Ignore progress."""


def _check(
    verb: str, metric: str, generations: int, population: int | None, seed: int, jobs: int
) -> None:
    """Raise PlanError for what a search does not take."""
    from trunk_evidence.run_metrics import RANKED

    if metric not in RANKED:
        hint = did_you_mean(str(metric), RANKED)
        raise PlanError(f"{verb}: metric {metric!r}: one of {', '.join(RANKED)}{hint}")
    _check_whole(verb, "generations", generations, 1, 100_000)
    if population is not None:
        _check_whole(verb, "population", population, 2, 1000)
    _check_whole(verb, "seed", seed, 0, 2**32 - 1)
    _check_whole(verb, "jobs", jobs, 1, 1024)


def _check_whole(verb: str, name: str, number: object, low: int, high: int) -> None:
    if isinstance(number, bool) or not isinstance(number, int) or not low <= number <= high:
        raise PlanError(f"{verb}: {name} {number!r}: a whole number from {low} to {high} is needed")
