"""One step of the plant as two pure functions: *sense* a state, *act* on it.

The simulator node, the offline run, the replay and the compiled loop compose these and add no
arithmetic. Time is not in here: a step takes one period, and the caller counts the steps. A real drive
changes a command by its dead band, resolution, bias, limits and lag; then comes the joint's friction.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor, inf, isfinite
from typing import Any, NamedTuple

from trunk_core.compiled import with_arrays
from trunk_core.elementary import exp

from .disturbances import Disturbance
from .plant import Accelerations, PlantState, advance

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


# ``forces(effort, disturbance, state, actuator)``: the forces on both coordinates over a period, N or N m.
Forces = Callable[[float, Disturbance, PlantState, Actuator | None], tuple[float, float]]


class Scale(NamedTuple):
    """Resolutions and limits of the measured trunk angle [rad] and rate [rad/s]; resolution 0: continuous."""

    position_resolution: float = 0.0
    velocity_resolution: float = 0.0
    position_limit: float = inf
    velocity_limit: float = inf


class SensorParameters(NamedTuple):
    """Standard deviations and biases of the measured trunk angle [rad] and rate [rad/s]."""

    position_noise: float = 0.0
    velocity_noise: float = 0.0
    position_bias: float = 0.0
    velocity_bias: float = 0.0
    scale: Scale | None = None  # None: continuous, and without limits


class PlantConstants(NamedTuple):
    """The constants of one run's plant: its own, of integration and actuator, and what counts as a fall."""

    constants: Any  # the last argument of its `Accelerations`
    period: float  # s
    substeps: int
    max_effort: float  # N m
    fall_angle: float  # rad
    actuator: Actuator | None = (
        None  # None: it delivers the command within its limit, without joint friction
    )


def of_one_type(plant: PlantConstants) -> PlantConstants:
    """Return constants in which None has become an empty array, or an actuator that changes nothing.

    So compiled code is the same for all of them.
    """
    own = plant.constants
    filled = own._replace(**{field: () for field, value in own._asdict().items() if value is None})
    return with_arrays(plant._replace(constants=filled, actuator=plant.actuator or Actuator()))


class PlantStatus(NamedTuple):
    """The plant between two steps."""

    state: PlantState
    effort: float  # N m, applied over the previous step
    fallen: bool  # this or an earlier state is beyond the fall angle
    diverged: bool  # the next step is not finite; this is the last finite state


class Measurement(NamedTuple):
    """What the sensors say: m, rad, m/s, rad/s."""

    x: float
    theta: float
    x_dot: float
    theta_dot: float


def timely_effort(effort: float, age_ns: int, timeout_ns: int) -> float:
    """Return the torque of the latest command, N m, ``age_ns`` after its state: 0 once it is too old."""
    return 0.0 if too_old(age_ns, timeout_ns) else effort


def too_old(age_ns: int, timeout_ns: int) -> bool:
    """Return True if a command of this age no longer acts."""
    return age_ns > timeout_ns


def at_rest(state: PlantState, plant: PlantConstants) -> PlantStatus:
    """Return the plant in a state before any torque: at the start, or after a reset."""
    return PlantStatus(state, 0.0, beyond_fall(state, plant), False)


def torque_of(before: float, effort: float, plant: PlantConstants) -> float:
    """Return the actuator's torque over a period, N m, after ``before`` and with a command, both N m."""
    return actuator_torque(before, effort, plant.max_effort, plant.actuator)


def noisy(p: SensorParameters) -> bool:
    """Return True if the samples that `sense` takes have an effect."""
    return p.position_noise != 0.0 or p.velocity_noise != 0.0


def sense(
    state: PlantState,
    disturbance: Disturbance,
    position_sample: float,
    velocity_sample: float,
    p: SensorParameters,
) -> Measurement:
    """Return ``true + offset + bias + sigma n`` for the trunk, with standard normal samples n, as it is read.

    ``state`` is the true state that the sensors see now, already delayed. The hip gets only its offset.
    """
    theta = (
        state.theta
        + disturbance.trunk_offset
        + p.position_bias
        + p.position_noise * position_sample
    )
    theta_dot = state.theta_dot + p.velocity_bias + p.velocity_noise * velocity_sample
    theta, theta_dot = as_read(theta, theta_dot, p.scale)
    return Measurement(state.x + disturbance.hip_offset, theta, state.x_dot, theta_dot)


def as_read(theta: float, theta_dot: float, scale: Scale | None) -> tuple[float, float]:
    """Return angle and rate as the sensors give them: multiples of their resolutions, within their limits."""
    if scale is None:
        return theta, theta_dot
    if scale.position_resolution > 0.0:
        theta = quantised(theta, scale.position_resolution)
    if scale.velocity_resolution > 0.0:
        theta_dot = quantised(theta_dot, scale.velocity_resolution)
    return saturate(theta, scale.position_limit), saturate(theta_dot, scale.velocity_limit)


def act(
    status: PlantStatus,
    effort: float,
    disturbance: Disturbance,
    plant: PlantConstants,
    forces: Forces,
    accelerations: Accelerations,
) -> PlantStatus:
    """Return the plant one period later, the commanded effort [N m] passed through the actuator.

    If the new state is not finite, the old one stays and is marked ``diverged``.
    """
    torque = torque_of(status.effort, effort, plant)
    return integrate(status, torque, disturbance, plant, forces, accelerations)


def on_first(
    effort: float, disturbance: Disturbance, state: PlantState, actuator: Actuator | None
) -> tuple[float, float]:
    """Return the forces on both coordinates over a period; the drive, with friction, acts on the first."""
    driven = with_friction(effort + disturbance.hip_force, state.x_dot, actuator)
    return driven, disturbance.trunk_torque


def on_second(
    effort: float, disturbance: Disturbance, state: PlantState, actuator: Actuator | None
) -> tuple[float, float]:
    """Return the forces on both coordinates, as `on_first` does; the drive acts on the second."""
    driven = with_friction(effort + disturbance.trunk_torque, state.theta_dot, actuator)
    return disturbance.hip_force, driven


class Dynamics(NamedTuple):
    """The functions that move a plant, for which code is made."""

    forces: Forces  # `on_first` or `on_second`
    accelerations: Accelerations


def integrate(
    status: PlantStatus,
    torque: float,
    disturbance: Disturbance,
    plant: PlantConstants,
    forces: Forces,
    accelerations: Accelerations,
) -> PlantStatus:
    """Return the plant one period later, with the actuator's torque [N m] held over it; as `act` does."""
    first, second = forces(torque, disturbance, status.state, plant.actuator)
    state = advance(
        status.state,
        first,
        second,
        plant.period,
        plant.substeps,
        plant.constants,
        accelerations,
    )
    if not finite(state):
        return PlantStatus(status.state, status.effort, status.fallen, True)
    return PlantStatus(state, torque, status.fallen or beyond_fall(state, plant), False)


def finite(state: PlantState) -> bool:
    """Return True if all four numbers of a state are finite."""
    return (
        isfinite(state.x)
        and isfinite(state.theta)
        and isfinite(state.x_dot)
        and isfinite(state.theta_dot)
    )


def beyond_fall(state: PlantState, plant: PlantConstants) -> bool:
    """Return True if the trunk leans further than the fall angle."""
    return abs(state.theta) > plant.fall_angle
