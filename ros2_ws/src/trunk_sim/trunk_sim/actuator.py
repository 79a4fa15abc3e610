"""How a real drive changes a command: dead band, resolution, bias, limits, lag; and the joint's friction.

Pure: scalar functions of floats and a named tuple, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import floor, inf
from typing import NamedTuple

from trunk_msgs_util.elementary import exp

# Below this speed Coulomb friction is proportional to the speed, so that it does not chatter at rest.
STICKING = 0.01  # rad/s
_FINEST = 2.0**52  # from here on all doubles are integers


class Actuator(NamedTuple):
    """A drive's constants for one period of the plant; the defaults change nothing."""

    approach: float = 1.0  # fraction of the way to its target that the torque covers in a period
    step: float = inf  # N m, the largest change in a period
    dead_band: float = 0.0  # N m
    resolution: float = 0.0  # N m; 0: continuous
    bias: float = 0.0  # N m
    coulomb: float = 0.0  # N m
    viscous: float = 0.0  # N m s/rad


def approach_of(time_constant: float, period: float) -> float:
    """Return ``1 - exp(-h / T)``, h and T in s: a first-order lag's step towards a constant target.

    1 without a lag. The exact solution of ``T dtau/dt = target - tau`` after a period.
    """
    return 1.0 - exp(-period / time_constant) if time_constant > 0.0 else 1.0


def saturate(effort: float, limit: float) -> float:
    """Return the effort in N m, clamped to +- limit."""
    return limit if effort > limit else -limit if effort < -limit else effort


def quantised(value: float, resolution: float) -> float:
    """Return ``q floor(v / q + 1/2)`` for a resolution q; the value where a double is coarser."""
    steps = value / resolution
    if abs(steps) < _FINEST:
        return resolution * floor(steps + 0.5)
    return value


def actuator_torque(before: float, effort: float, limit: float, a: Actuator | None) -> float:
    """Return the drive's torque over a period, N m, after ``before`` and with a command, both N m.

    Without constants it is the command within its limit; otherwise, in this order, skipping neutral steps::

        u_1 = 0 if |u| <= d else u - sign(u) d             dead band
        u_2 = q floor(u_1 / q + 1/2)                       resolution
        u_3 = u_2 + b                                      bias
        u_4 = clamp(u_3, +- limit)                         saturation
        u_5 = tau + clamp(u_4 - tau, +- r h)               rate limit
        tau+ = tau + (1 - exp(-h / T)) (u_5 - tau)         first-order lag

    Textbook models of drives, such as Astrom and Murray, Feedback Systems (2nd ed.), ch. 3 and 10.
    """
    if a is None:
        return saturate(effort, limit)
    torque = effort
    if a.dead_band > 0.0:
        if abs(torque) <= a.dead_band:
            torque = 0.0
        else:
            torque = torque - a.dead_band if torque > 0.0 else torque + a.dead_band
    if a.resolution > 0.0:
        torque = quantised(torque, a.resolution)
    if a.bias != 0.0:
        torque = torque + a.bias
    torque = saturate(torque, limit)
    if a.step < inf:
        torque = before + saturate(torque - before, a.step)
    if a.approach < 1.0:
        torque = before + a.approach * (torque - before)
    return torque


def with_friction(torque: float, rate: float, a: Actuator | None) -> float:
    """Return a torque plus that of friction in the joint, N m, at the trunk's rate in rad/s.

    ``tau - b w - c clamp(w / w_0, +- 1)`` with viscous b, Coulomb c and w_0 = 0.01 rad/s (`STICKING`). The
    plant holds it over a period; that is stable while ``b h < 2 m l^2``.
    """
    if a is None:
        return torque
    if a.viscous != 0.0:
        torque = torque - a.viscous * rate
    if a.coulomb != 0.0:
        torque = torque - a.coulomb * saturate(rate / STICKING, 1.0)
    return torque
