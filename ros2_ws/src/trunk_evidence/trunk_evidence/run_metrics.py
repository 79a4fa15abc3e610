"""Performance measures of a run: overshoot, settling, steady state, integrals of error and effort."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, isnan, nan, pi, radians, sqrt
from typing import TYPE_CHECKING, Annotated, NamedTuple

from trunk_core.results import Quantity, html_table, number, quantities, text_table
from trunk_core.units import seconds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from trunk_core.arrays import Floats


SETTLING_BAND_DEG = 6.0
SETTLING_BAND = radians(SETTLING_BAND_DEG)  # rad


class Sums(NamedTuple):
    """Sums and extremes of the rows so far, with what the next row needs from the last."""

    t: float  # s
    error: float  # reference - theta, rad
    torque: float  # N m
    iae: float  # twice the integral, as the next two
    ise: float
    itae: float
    effort: float  # N^2 m^2 s
    peak_torque: float  # N m
    lowest: float  # rad
    highest: float  # rad
    level: float  # rad, the reference's
    level_since: float  # s
    level_from: float  # rad, the angle when the level began
    level_lowest: float  # rad, since then
    level_highest: float  # rad
    settled_at: float  # s, since when the error has been in the band; infinite outside
    steady_rows: float  # those in the steady state
    steady_sum: float  # of their errors, rad
    steady_squares: float  # rad^2


def _greater(a: float, b: float) -> float:
    return b if b > a else a


def _smaller(a: float, b: float) -> float:
    return b if b < a else a


def no_rows(t: float) -> Sums:
    """Return the sums before the first row, which is at t [s]."""
    return Sums(
        t,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        inf,
        -inf,
        nan,
        t,
        0.0,
        inf,
        -inf,
        inf,
        0.0,
        0.0,
        0.0,
    )


def with_row(
    s: Sums, t: float, theta: float, reference: float, torque: float, steady_from: float
) -> Sums:
    """Return the sums with one more row; from t = ``steady_from`` on it counts for the steady state.

    Integrals use the trapezoidal rule; for the effort, a torque is held until the next row.
    """
    step = t - s.t
    error = reference - theta
    size, before = abs(error), abs(s.error)
    level, since, started = s.level, s.level_since, s.level_from
    low, high, settled_at = s.level_lowest, s.level_highest, s.settled_at
    if reference != level:
        level, since, started = reference, t, theta
        low, high, settled_at = inf, -inf, inf
    if size > SETTLING_BAND:
        settled_at = inf
    elif settled_at == inf:
        settled_at = t
    steady = 1.0 if t >= steady_from else 0.0
    return Sums(
        t,
        error,
        torque,
        s.iae + step * (size + before),
        s.ise + step * (error * error + s.error * s.error),
        s.itae + step * (t * size + s.t * before),
        s.effort + step * (s.torque * s.torque),
        _greater(s.peak_torque, abs(torque)),
        _smaller(s.lowest, theta),
        _greater(s.highest, theta),
        level,
        since,
        started,
        _smaller(low, theta),
        _greater(high, theta),
        settled_at,
        s.steady_rows + steady,
        s.steady_sum + (error if steady == 1.0 else 0.0),
        s.steady_squares + (error * error if steady == 1.0 else 0.0),
    )


class Measured(NamedTuple):
    """The sums of a run's rows so far, and the reference of the last update, rad."""

    sums: Sums
    reference: float


def with_rows(
    before: Measured,
    first: int,
    count: int,
    period_ns: int,
    steady: float,
    theta: int,
    torque: int,
    reference: int,
    fresh: int,
    out: Floats,
) -> Measured:
    """Return the sums with ``count`` more rows of a table [N, columns]; the first is state ``first``.

    The steady state begins at ``steady`` s. The four columns have the angle, rad, the torque over the step
    from the state, N m, the reference, rad, and 1.0 where it is that of an update. Exported as C unchanged.
    """
    sums, level = before.sums, before.reference
    for row in range(count):
        if out[row, fresh] == 1.0:
            level = float(out[row, reference])
        sums = with_row(
            sums,
            seconds((first + row) * period_ns),
            float(out[row, theta]),
            level,
            float(out[row, torque]),
            steady,
        )
    return Measured(sums, level)


SETTLED_FOR = 1.0  # s that must remain after settling
STEADY_STATE = 2.0  # s at the end
_TOLERANCE = 1e-9  # s, for times that are sums of rounded periods
_DEGREES = 180.0 / pi  # a radian, as `math.degrees` has it


@dataclass(frozen=True)
class Metrics:
    """Quantities of the true error ``e = reference - theta``; None where a run has no such value.

    Made by `metrics`. ``as_dict()`` returns them by name; ``print`` shows a table with units.
    """

    overshoot_deg: Annotated[
        float | None,
        Quantity(
            "overshoot",
            "°",
            "how far the angle goes past the reference's last level, seen from the angle at "
            "which that level began; 0 if it never does. Undefined if the angle began at the "
            "level",
        ),
    ]
    settling_time_6deg_s: Annotated[
        float | None,
        Quantity(
            "settling time, ±6°",
            "s",
            "from the last change of the reference until |e| is at most 6° and stays so to "
            "the end; never unless at least 1 s remains after it",
        ),
    ]
    steady_state_error_mean_deg: Annotated[
        float | None, Quantity("steady-state error, mean", "°", "mean of e over the last 2 s")
    ]
    steady_state_error_rms_deg: Annotated[
        float | None,
        Quantity("steady-state error, RMS", "°", "root mean square of e over the last 2 s"),
    ]
    iae: Annotated[float, Quantity("IAE, ∫|e| dt", "rad·s", "∫ |e| dt, by trapezoids")]
    ise: Annotated[float, Quantity("ISE, ∫e² dt", "rad²·s", "∫ e² dt, by trapezoids")]
    itae: Annotated[
        float,
        Quantity("ITAE, ∫t|e| dt", "rad·s²", "∫ t |e| dt, by trapezoids: late errors weigh more"),
    ]
    effort: Annotated[
        float,
        Quantity(
            "effort, ∫τ² dt", "N²·m²·s", "∫ τ² dt, each torque times the period over which it acted"
        ),
    ]
    peak_torque: Annotated[float, Quantity("peak torque", "N·m", "the largest |τ|")]
    theta_min_deg: Annotated[
        float, Quantity("smallest angle", "°", "the smallest angle", ranked=False)
    ]
    theta_max_deg: Annotated[
        float, Quantity("largest angle", "°", "the largest angle", ranked=False)
    ]

    def as_dict(self) -> dict[str, float | None]:
        """Return the quantities by name, in order."""
        return dict(vars(self))

    def rows(self) -> list[tuple[str, str, str]]:
        """Return each quantity's label, its value as text, and its unit."""
        values = self.as_dict()
        return [(q.label, number(values[key]), q.unit) for key, q in QUANTITIES.items()]

    def __str__(self) -> str:
        return text_table(self.rows())

    def _repr_html_(self) -> str:
        return html_table("Metrics", ("quantity", "value", "unit"), self.rows())


QUANTITIES: Mapping[str, Quantity] = quantities(Metrics)
RANKED = tuple(name for name, text in QUANTITIES.items() if text.ranked)


def _is_level(since: float, begin: float, end: float) -> bool:
    return since == begin or end - since >= SETTLED_FOR - _TOLERANCE


def _checked(run_metrics: Metrics) -> Metrics:
    for name, value in run_metrics.as_dict().items():
        if value is not None and not isfinite(value) and name != SETTLING:
            raise ValueError(f"{name} is too large for a floating-point number: no metrics")
    return run_metrics


def steady_from(end: float) -> float:
    """Return when the steady state begins in a run that ends at ``end`` [s]."""
    return end - STEADY_STATE - _TOLERANCE


class MetricNumbers(NamedTuple):
    """The fields of `Metrics`, NaN for None."""

    overshoot_deg: float
    settling_time_6deg_s: float
    steady_state_error_mean_deg: float
    steady_state_error_rms_deg: float
    iae: float
    ise: float
    itae: float
    effort: float
    peak_torque: float
    theta_min_deg: float
    theta_max_deg: float


MAY_BE_UNDEFINED = MetricNumbers._fields[:4]
SETTLING = "settling_time_6deg_s"  # infinite: never


def numbers_of(s: Sums, begin: float) -> MetricNumbers:
    """Return the metrics of a run that began at ``begin`` [s]. It is exported as C unchanged."""
    overshoot, settling_time, mean, rms = nan, nan, nan, nan
    if _is_level(s.level_since, begin, s.t):
        overshoot, settling_time = _overshoot(s), _settling_time(s)
    if s.t - begin >= STEADY_STATE - _TOLERANCE:
        mean = _DEGREES * (s.steady_sum / s.steady_rows)
        rms = _DEGREES * sqrt(s.steady_squares / s.steady_rows)
    return MetricNumbers(
        overshoot,
        settling_time,
        mean,
        rms,
        s.iae / 2.0,
        s.ise / 2.0,
        s.itae / 2.0,
        s.effort,
        s.peak_torque,
        _DEGREES * s.lowest,
        _DEGREES * s.highest,
    )


def metrics_of(sums: Sums, begin: float) -> Metrics:
    """Return the metrics of a run that began at ``begin`` [s]. Raises ValueError if one is infinite."""
    return metrics_from(numbers_of(sums, begin))


def metrics_from(metrics: MetricNumbers) -> Metrics:
    """Return the metrics with these numbers. Raises ValueError if one is infinite."""
    numbers = metrics._asdict()
    undefined = {name: None for name in MAY_BE_UNDEFINED if isnan(numbers[name])}
    return _checked(Metrics(**{**numbers, **undefined}))


def _overshoot(s: Sums) -> float:
    """Return the excursion past the level in degrees; NaN if the angle began at it."""
    if s.level_from == s.level:
        return nan
    beyond = s.level_highest - s.level if s.level_from < s.level else s.level - s.level_lowest
    beyond *= _DEGREES
    return beyond if beyond > 0.0 else 0.0


def _settling_time(s: Sums) -> float:
    """Return the time in s from the level's start after which the error stays in the band to the end.

    Infinite: it never does.
    """
    if s.settled_at == inf or s.t - s.settled_at < SETTLED_FOR - _TOLERANCE:
        return inf
    return s.settled_at - s.level_since
