"""Performance measures of a run: overshoot, settling, steady state, integrals of error and effort."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import degrees, isfinite, radians
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from trunk_msgs_util.recording.joint_arrays import Floats

    from .run_table import RunTable

SETTLING_BAND_DEG = 6.0
SETTLING_BAND = radians(SETTLING_BAND_DEG)  # rad
SETTLED_FOR = 1.0  # s that must remain after settling
STEADY_STATE = 2.0  # s at the end
_TOLERANCE = 1e-9  # s, for times that are sums of rounded periods


class Quantity(NamedTuple):
    """A metric's name and unit, and whether a smaller magnitude is better."""

    label: str
    unit: str
    judged: bool = True


QUANTITIES: Mapping[str, Quantity] = {
    "overshoot_deg": Quantity("overshoot", "°"),
    "settling_time_6deg_s": Quantity("settling time, ±6°", "s"),
    "steady_state_error_mean_deg": Quantity("steady-state error, mean", "°"),
    "steady_state_error_rms_deg": Quantity("steady-state error, RMS", "°"),
    "iae": Quantity("IAE, ∫|e| dt", "rad·s"),
    "ise": Quantity("ISE, ∫e² dt", "rad²·s"),
    "itae": Quantity("ITAE, ∫t|e| dt", "rad·s²"),
    "effort": Quantity("effort, ∫τ² dt", "N²·m²·s"),
    "peak_torque": Quantity("peak torque", "N·m"),
    "theta_min_deg": Quantity("smallest angle", "°", judged=False),
    "theta_max_deg": Quantity("largest angle", "°", judged=False),
}


@dataclass(frozen=True)
class Metrics:
    """Quantities of the true error ``e = reference - theta``; None if undefined.

    ::

        iae, ise, itae    integrals of |e|, e^2, t |e| by trapezoids      rad s, rad^2 s, rad s^2
        effort            sum of (t_k+1 - t_k) torque_k^2, k < N          N^2 m^2 s
        peak_torque       max |torque|                                    N m
    """

    overshoot_deg: float | None
    settling_time_6deg_s: float | None
    steady_state_error_mean_deg: float | None
    steady_state_error_rms_deg: float | None
    iae: float
    ise: float
    itae: float
    effort: float
    peak_torque: float
    theta_min_deg: float
    theta_max_deg: float

    def as_dict(self) -> dict[str, float | None]:
        """Return the quantities by name, in order."""
        return asdict(self)


def metrics(table: RunTable) -> Metrics:
    """Return the metrics of a run.

    Overshoot and settling refer to the reference's last level and count from its last change (t_0 if
    it is constant). A reference that still changes in the last second (a sine, or a level set too
    late) has no such level: both are None. Raises ValueError for a table without rows, with data that
    are not finite, or with such as make a metric infinite.
    """
    _check(table)
    t, theta, torque = table.t, table.theta, table.torque
    error = table.reference - theta
    with np.errstate(over="ignore"):
        return _checked(_computed(t, theta, torque, error, table.reference))


def _checked(found: Metrics) -> Metrics:
    for name, value in found.as_dict().items():
        if value is not None and not isfinite(value):
            raise ValueError(f"{name} is beyond the numbers of a computer: no metrics")
    return found


def _computed(
    t: Floats, theta: Floats, torque: Floats, error: Floats, reference: Floats
) -> Metrics:
    changes = np.flatnonzero(np.diff(reference)) + 1
    start = int(changes[-1]) if len(changes) else 0
    has_level = start == 0 or t[-1] - t[start] >= SETTLED_FOR - _TOLERANCE
    mean, rms = _steady_state(t, error)
    return Metrics(
        overshoot_deg=_overshoot(theta[start:], reference[-1]) if has_level else None,
        settling_time_6deg_s=_settling_time(t[start:], error[start:]) if has_level else None,
        steady_state_error_mean_deg=mean,
        steady_state_error_rms_deg=rms,
        iae=_integral(t, np.abs(error)),
        ise=_integral(t, error**2),
        itae=_integral(t, t * np.abs(error)),
        effort=float(np.sum(np.diff(t) * torque[:-1] ** 2)),
        peak_torque=float(np.max(np.abs(torque))),
        theta_min_deg=degrees(np.min(theta)),
        theta_max_deg=degrees(np.max(theta)),
    )


def _check(table: RunTable) -> None:
    if not len(table.t):
        raise ValueError("metrics need at least one state; the run has none")
    if np.isnan(table.reference[0]):
        raise ValueError(
            "no controller of ours has told its reference by the first state: no metrics"
        )
    for name in ("t", "theta", "reference", "torque"):
        bad = np.flatnonzero(~np.isfinite(getattr(table, name)))
        if len(bad):
            raise ValueError(f"{name} is not finite at t = {table.t[bad[0]]:g} s: no metrics")


def _overshoot(theta: Floats, target: float) -> float | None:
    """Return the excursion past the target in degrees; None if the first angle is the target."""
    direction = np.sign(target - theta[0])
    if direction == 0.0:
        return None
    return max(0.0, degrees(np.max(direction * (theta - target))))


def _settling_time(t: Floats, error: Floats) -> float | None:
    """Return the time in s after which the error stays in the band to the end."""
    outside = np.flatnonzero(np.abs(error) > SETTLING_BAND)
    settled = int(outside[-1]) + 1 if len(outside) else 0
    if settled == len(t) or t[-1] - t[settled] < SETTLED_FOR - _TOLERANCE:
        return None
    return float(t[settled] - t[0])


def _steady_state(t: Floats, error: Floats) -> tuple[float | None, float | None]:
    """Return mean and RMS of the error in degrees; None if the run is too short."""
    if t[-1] - t[0] < STEADY_STATE - _TOLERANCE:
        return None, None
    last = error[t >= t[-1] - STEADY_STATE - _TOLERANCE]
    return degrees(np.mean(last)), degrees(np.sqrt(np.mean(last**2)))


def _integral(t: Floats, values: Floats) -> float:
    return float(np.sum(np.diff(t) * (values[1:] + values[:-1])) / 2.0)
