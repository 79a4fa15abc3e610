"""The law ``computed_torque``: its parameters, declared once, and its functions."""

from __future__ import annotations

from dataclasses import dataclass

from trunk_msgs_util.mechanics import Body, inverse_dynamics
from trunk_msgs_util.parameters.body import body_of, body_parameter
from trunk_msgs_util.parameters.declarations import parameter

from .computed_torque import computed_torque_update
from .controller_config import ControllerConfig
from .law import Sample
from .pid import Gains, PidLaw, PidState, Terms
from .pid_kind import law_of_pid_kind


@dataclass(frozen=True)
class ComputedTorqueConfig(ControllerConfig):
    """Parameters of the ``computed_torque`` node. Both default poles lie at -10 1/s."""

    hip_joint: str = parameter(
        "hip_joint", "hip", "The joint whose measured motion the model uses", fixed=True
    )
    p: float = parameter(
        "gains.p", 100.0, "Acceleration per unit of error", unit="1/s^2", minimum=0.0, maximum=1e9
    )
    i: float = parameter(
        "gains.i",
        0.0,
        "Acceleration per unit of its integral",
        unit="1/s^3",
        minimum=0.0,
        maximum=1e9,
    )
    d: float = parameter(
        "gains.d", 20.0, "Acceleration per unit of its rate", unit="1/s", minimum=0.0, maximum=1e9
    )
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
    def gains(self) -> Gains:
        """The gains, as accelerations."""
        return Gains(self.p, self.i, self.d)

    @property
    def model(self) -> Body:
        """The plant as the controller believes it to be."""
        return body_of(self)

    @property
    def constants(self) -> tuple[Gains, Body]:
        """The gains, as accelerations, and the model."""
        return self.gains, self.model

    @property
    def damping_gain(self) -> float:
        """The largest gain of the rate, N m s/rad: at the model's largest inertia."""
        return self.d * self.trunk_mass * self.length * self.length

    @property
    def hip(self) -> str:
        """The joint whose motion the law uses."""
        return self.hip_joint


def update(
    state: PidState, sample: Sample, constants: tuple[Gains, Body], law: PidLaw
) -> tuple[PidState, Terms]:
    """Return one update of `computed_torque_update`."""
    s = sample
    return computed_torque_update(
        state, s.reference, s.measurement, s.rate, s.dt, s.hip, constants[0], constants[1], law
    )


def gains(state: PidState, sample: Sample, constants: tuple[Gains, Body]) -> Gains:
    """Return the gains times the inertia at the last sample."""
    hip, wanted = sample.hip, constants[0]
    inertia, _ = inverse_dynamics(
        hip.position, sample.measurement, hip.velocity, sample.rate, constants[1]
    )
    return Gains(inertia * wanted.p, inertia * wanted.i, inertia * wanted.d)


LAW = law_of_pid_kind("computed_torque", "Computed torque", ComputedTorqueConfig, update, gains)
