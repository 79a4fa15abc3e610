"""The law ``computed_torque``: a model's inverse dynamics turns a desired angular acceleration into a torque.

The model belongs to the controller: its constants may be wrong, as on a real robot.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass

from trunk_core.mechanics import Body, inverse_dynamics
from trunk_core.parameters.declarations import parameter
from trunk_core.parameters.shared import body_of, body_parameter

from .law import ControllerConfig, Limits, Sample
from .pid_family import (
    Gains,
    PidState,
    Terms,
    WithGains,
    alpha_of,
    combine,
    error_derivative,
    gain,
    held,
    law_of_pid_family,
    usable,
)


@dataclass(frozen=True)
class ComputedTorqueConfig(WithGains, ControllerConfig):
    """Parameters of the ``computed_torque`` node. Both default poles lie at -10 1/s."""

    hip_joint: str = parameter(
        "hip_joint", "hip", "The joint whose measured motion the model uses", fixed=True
    )
    p: float = gain("p", 100.0, "Acceleration per unit of error", "1/s^2")
    i: float = gain("i", 0.0, "Acceleration per unit of its integral", "1/s^3")
    d: float = gain("d", 20.0, "Acceleration per unit of its rate", "1/s")
    hip_mass: float = body_parameter("model.hip_mass", "hip_mass", believed=True)
    trunk_mass: float = body_parameter("model.trunk_mass", "trunk_mass", believed=True)
    length: float = body_parameter("model.length", "length", believed=True)
    gravity: float = body_parameter("model.gravity", "gravity", believed=True)
    amplitude: float = body_parameter("model.path_amplitude", "amplitude", believed=True)
    wavenumber: float = body_parameter("model.path_wavenumber", "wavenumber", believed=True)
    cosines: tuple[float, ...] = body_parameter("model.path_cosines", "cosines", believed=True)
    sines: tuple[float, ...] = body_parameter("model.path_sines", "sines", believed=True)
    hip_mode: str = body_parameter("model.hip_mode", "hip_mode", believed=True)

    @property
    def model(self) -> Body:
        """The plant as the controller believes it to be."""
        return body_of(self)

    @property
    def constants(self) -> tuple[Gains, Body, bool]:
        """The gains, as accelerations; the model; True if its hip keeps its speed whatever the trunk does."""
        return self.gains, self.model, self.hip_mode == "prescribed"

    @property
    def damping_gain(self) -> float:
        """The largest gain of the rate, N m s/rad: at the model's largest inertia."""
        return self.d * self.trunk_mass * self.length * self.length

    @property
    def hip(self) -> str:
        """The joint whose motion the law uses."""
        return self.hip_joint


def computed_torque_update(
    state: PidState, sample: Sample, constants: tuple[Gains, Body, bool], limits: Limits
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = H (kp e + ki I + kd D) + c``.

    The gains give accelerations: 1/s^2, 1/s^3, 1/s; with an exact model the error then obeys
    ``e'' + kd e' + kp e + ki I = 0``. The terms carry the gains times H. The model uses the rate [rad/s] in
    every derivative mode. Holds the last command as `pid_update` does.
    """
    gains, body, prescribed = constants
    reference, measurement, rate, dt, hip = sample
    error = reference - measurement
    if not usable(error, rate + hip.position + hip.velocity, dt):
        return held(state, gains, alpha_of(gains), limits)
    inertia, bias = inverse_dynamics(
        hip.position, measurement, hip.velocity, rate, body, prescribed
    )
    effective = Gains(inertia * gains.p, inertia * gains.i, inertia * gains.d)
    alpha = alpha_of(effective)
    if not usable(error, bias, dt):  # the squares of finite rates may overflow
        return held(state, effective, alpha, limits)
    derivative = error_derivative(state, error, measurement, rate, dt, limits)
    return combine(state, error, measurement, derivative, dt, effective, alpha, limits, bias)


def effective_gains(state: PidState, sample: Sample, constants: tuple[Gains, Body, bool]) -> Gains:
    """Return the gains times the inertia at the last sample."""
    hip, (gains, body, prescribed) = sample.hip, constants
    inertia, _ = inverse_dynamics(
        hip.position, sample.measurement, hip.velocity, sample.rate, body, prescribed
    )
    return Gains(inertia * gains.p, inertia * gains.i, inertia * gains.d)


LAW = law_of_pid_family(
    "computed_torque",
    "Computed torque",
    ComputedTorqueConfig,
    computed_torque_update,
    effective_gains,
    plant="trunk",
)
