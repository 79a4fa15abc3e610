"""Gains from a model, why a controller commanded a torque, and how large a parameter may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, radians
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from trunk_msgs_util.units import seconds

from ..errors import PlanError
from ..plans.plan import make_plan
from ._paths import AnyPath
from ._plan import Plan, plan
from ._run import Run
from ._simulate import run_of
from ._values import mapping_of, names_of

if TYPE_CHECKING:
    from ..replay.explain import Explanation


class Limit(NamedTuple):
    """How far a parameter may go. Made by `limit`; in the parameter's SI unit.

    ``stands``: from ``low`` to here every tried value stands; None: ``low`` falls. ``falls``: the first tried
    value beyond it, which falls; None: none does. ``stands_again``: tried values beyond that, which stand.
    ``runs``: how many runs it took.
    """

    stands: float | None
    falls: float | None
    stands_again: tuple[float, ...]
    runs: int


def explain(run: Run | AnyPath, at: float) -> Explanation:
    """Return why the controller commanded its torque at ``at`` s, as `trunk explain` says it.

    Its attributes are ``controller``, ``reference``, ``measurement``, ``rate``, ``terms`` (P, I and D, gains,
    or a law's own), ``rules`` (those that fired), ``limits``, ``windup``, ``disturbance``, ``true_angle``,
    ``recorded`` and ``applied``, in SI units and radians; ``agrees`` is True if the recomputed command is the
    recorded one, bit by bit.

    Raises RecordingError for an instant outside the run, or if the run lacks what is needed.
    """
    from ..replay.explain import explain

    return explain(run_of(run)._recorded, float(at))


def tune(
    controller: str = "lqr",
    *,
    poles: Sequence[float] = (-12.0, -8.0, -2.0),
    largest: Mapping[str, float] = MappingProxyType({}),
    params: AnyPath | Sequence[AnyPath] = (),
    rate: float | None = None,
    discrete: bool = False,
) -> dict[str, float]:
    """Return gains for the trunk linearised about the upright, as overrides for `plan`.

    ``controller``: ``lqr`` solves the Riccati equation, as `trunk tune lqr` does; ``pid`` and
    ``computed_torque`` place the ``poles``, in 1/s, two or three, as `trunk tune poles` does.
    ``largest``: for ``lqr``, the largest acceptable ``integral`` [rad s], ``angle`` [rad], ``speed`` [rad/s]
    and ``torque`` [N m]; by default 0.1, 6 degrees, 1 and 5.
    ``params``: parameter files with the plant, by path or name; later ones win. ``rate``: in Hz.
    ``discrete``: for ``lqr``, solve the equation of the sampled trunk, its torque held over each period.

    Raises PlanError for any other controller or name.
    """
    from ..tuning.linear import linearise
    from ..tuning.methods import by_lqr, by_poles

    if controller not in ("lqr", "pid", "computed_torque"):
        raise PlanError(f"tune: controller {controller!r}: one of lqr, pid, computed_torque")
    everywhere = {} if rate is None else {"update_rate": float(rate)}
    files = ["profile_practical", *names_of(params, "params")]
    sampled = make_plan("fig6", controller, files, (), everywhere)
    plant = linearise(sampled.simulator.body)
    others: dict[str, float] = {}
    if controller == "lqr":
        bounds = {"integral": 0.1, "angle": radians(6.0), "speed": 1.0, "torque": 5.0}
        given = mapping_of(largest, "largest", "{'torque': 5.0}")
        for name, value in given.items():
            if name not in bounds or not (isfinite(value) and value > 0.0):
                raise PlanError(
                    f"tune: largest {name!r} {value!r}: above 0, of {', '.join(bounds)}, is needed"
                )
        period = seconds(sampled.controller.period_ns) if discrete else 0.0
        integral, angle, speed, torque = {**bounds, **given}.values()
        gains = by_lqr(plant, integral, angle, speed, torque, period)
        others["lqr.model.gravity_torque"] = plant.a / plant.b
    else:
        if controller == "computed_torque":
            plant = plant._replace(a=0.0, b=1.0)  # what is left after inverse dynamics
        gains = by_poles(plant, tuple(map(float, poles)))
    return {**{f"{controller}.gains.{n}": getattr(gains, n) for n in "pid"}, **others}


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
    from ..study.limit import find_limit

    if not (isfinite(low) and isfinite(high) and low != high and 0.0 < within <= 1.0):
        raise PlanError(
            f"limit: low {low!r}, high {high!r}, within {within!r}: two ends are needed, within up to 1"
        )

    def at(value: float) -> Plan:
        return plan(scenario, controller, params=params, overrides={**overrides, vary: value})

    exact = within * abs(high - low)
    return Limit(*find_limit(lambda value: at(value)._plan, low, high, exact))
