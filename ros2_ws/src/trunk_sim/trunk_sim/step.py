"""One step of the plant as two pure functions: *sense* a state, *act* on it.

The simulator node, the offline run, the replay and the compiled loop compose these and add no
arithmetic. Time is not in here: a step takes one period, and the caller counts the steps.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import Any, NamedTuple

from trunk_msgs_util.compiled import with_arrays
from trunk_msgs_util.mechanics import Body

from .actuator import Actuator, actuator_torque, quantised, saturate, with_friction
from .disturbances import Disturbance
from .plant import PlantState, advance


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


class Plant(NamedTuple):
    """The constants of one run's plant: body, integration, actuator and what counts as a fall."""

    body: Body
    period: float  # s
    substeps: int
    max_effort: float  # N m
    fall_angle: float  # rad
    actuator: Actuator | None = (
        None  # None: it delivers the command within its limit, without joint friction
    )


def of_one_type(plant: Plant) -> Plant:
    """Return a plant whose harmonics are an array, empty if there are none, and that has an actuator.

    So compiled code is the same for all plants.
    """
    body = plant.body._replace(harmonics=plant.body.harmonics or ())
    return with_arrays(plant._replace(body=body, actuator=plant.actuator or Actuator()))


def pruned(plant: Plant) -> Plant:
    """Return a plant whose False flags are None, so that a compiler removes their branches, for lanes.

    Its harmonics, if it has any, are an array.
    """
    plant = with_arrays(plant)
    body: Any = plant.body
    return plant._replace(
        body=body._replace(prescribed=body.prescribed or None, as_printed=body.as_printed or None)
    )


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


def at_rest(state: PlantState, plant: Plant) -> PlantStatus:
    """Return the plant in a state before any torque: at the start, or after a reset."""
    return PlantStatus(state, 0.0, beyond_fall(state, plant), False)


def torque_of(before: float, effort: float, plant: Plant) -> float:
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


def act(status: PlantStatus, effort: float, disturbance: Disturbance, plant: Plant) -> PlantStatus:
    """Return the plant one period later, the commanded effort [N m] passed through the actuator.

    If the new state is not finite, the old one stays and is marked ``diverged``.
    """
    return integrate(status, torque_of(status.effort, effort, plant), disturbance, plant)


def torque_on(state: PlantState, torque: float, disturbance: Disturbance, plant: Plant) -> float:
    """Return the total torque on the trunk over a period, N m: actuator, disturbance, friction."""
    return with_friction(torque + disturbance.trunk_torque, state.theta_dot, plant.actuator)


def integrate(
    status: PlantStatus, torque: float, disturbance: Disturbance, plant: Plant
) -> PlantStatus:
    """Return the plant one period later, with the actuator's torque [N m] held over it; as `act` does."""
    state = advance(
        status.state,
        disturbance.hip_force,
        torque_on(status.state, torque, disturbance, plant),
        plant.period,
        plant.substeps,
        plant.body,
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


def beyond_fall(state: PlantState, plant: Plant) -> bool:
    """Return True if the trunk leans further than the fall angle."""
    return abs(state.theta) > plant.fall_angle
