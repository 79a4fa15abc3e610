"""Parameters of the controllers that rest on a model of the plant: LQR and computed torque."""

from __future__ import annotations

from dataclasses import dataclass

from trunk_msgs_util.parameters.declarations import parameter

from .computed_torque import Model
from .controller_config import ControllerConfig
from .pid import Gains


@dataclass(frozen=True)
class LqrConfig(ControllerConfig):
    """Parameters of the ``lqr`` node.

    The default gains are those of Table 5's trunk (``m l^2 = 0.5``, ``m g l = 4.905``) with the weights
    I_0 = 0.1 rad s, e_0 = 6 deg, w_0 = 1 rad/s, u_0 = 5 N m, from the Riccati equation in continuous time.
    """

    p: float = parameter(
        "gains.p", 61.7853, "Gain of the angle's error", unit="N m/rad", minimum=0.0, maximum=1e9
    )
    i: float = parameter(
        "gains.i", 50.0, "Gain of its integral", unit="N m/(rad s)", minimum=0.0, maximum=1e9
    )
    d: float = parameter(
        "gains.d", 9.31586, "Gain of its rate", unit="N m s/rad", minimum=0.0, maximum=1e9
    )
    gravity_torque: float = parameter(
        "model.gravity_torque",
        4.905,
        "G = m g l of the torque -G sin(reference) that holds the trunk there; 0: no feed-forward",
        unit="N m",
        minimum=0.0,
        maximum=1e9,
    )

    @property
    def gains(self) -> Gains:
        """The gains."""
        return Gains(self.p, self.i, self.d)

    @property
    def damping_gain(self) -> float:
        """The gain of the rate, N m s/rad."""
        return self.d


@dataclass(frozen=True)
class ComputedTorqueConfig(ControllerConfig):
    """Parameters of the ``computed_torque`` node. The default poles lie at -10 1/s, both."""

    hip_joint: str = parameter(
        "hip_joint", "hip", "The joint whose measured motion the model takes in", fixed=True
    )
    p: float = parameter(
        "gains.p", 100.0, "Acceleration per error", unit="1/s^2", minimum=0.0, maximum=1e9
    )
    i: float = parameter(
        "gains.i", 0.0, "Acceleration per integral of it", unit="1/s^3", minimum=0.0, maximum=1e9
    )
    d: float = parameter(
        "gains.d", 20.0, "Acceleration per rate of it", unit="1/s", minimum=0.0, maximum=1e9
    )
    hip_mass: float = parameter(
        "model.hip_mass",
        2.0,
        "Mass M that the model gives the hip",
        unit="kg",
        above=0.0,
        maximum=1e6,
    )
    trunk_mass: float = parameter(
        "model.trunk_mass", 0.5, "Mass m of its trunk", unit="kg", above=0.0, maximum=1e6
    )
    length: float = parameter(
        "model.length",
        1.0,
        "Its distance l from hip to centre of mass",
        unit="m",
        above=0.0,
        maximum=1e3,
    )
    gravity: float = parameter(
        "model.gravity", 9.81, "Its gravity g", unit="m/s^2", minimum=0.0, maximum=1e3
    )
    amplitude: float = parameter(
        "model.path_amplitude",
        1.0,
        "Amplitude A of the hip's path that it assumes",
        unit="m",
        minimum=-1e3,
        maximum=1e3,
    )
    wavenumber: float = parameter(
        "model.path_wavenumber",
        1.0,
        "Wave number k of that path",
        unit="rad/m",
        minimum=0.0,
        maximum=1e3,
    )
    hip_mode: str = parameter(
        "model.hip_mode",
        "passive",
        "passive: the model's hip rolls freely; prescribed: it keeps its horizontal speed",
        choices=("passive", "prescribed"),
    )

    @property
    def gains(self) -> Gains:
        """The gains, as accelerations."""
        return Gains(self.p, self.i, self.d)

    @property
    def model(self) -> Model:
        """What the controller believes of the plant."""
        return Model(
            self.hip_mass,
            self.trunk_mass,
            self.length,
            self.gravity,
            self.amplitude,
            self.wavenumber,
            self.hip_mode == "prescribed",
        )

    @property
    def damping_gain(self) -> float:
        """The largest gain of the rate, N m s/rad: at the model's largest inertia."""
        return self.d * self.trunk_mass * self.length**2

    @property
    def hip(self) -> str:
        """The joint whose motion the law takes in."""
        return self.hip_joint
