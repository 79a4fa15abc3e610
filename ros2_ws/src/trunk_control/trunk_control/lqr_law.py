"""The law ``lqr``: its parameters, declared once, and its functions."""

from __future__ import annotations

from dataclasses import dataclass

from trunk_msgs_util.mechanics import Body
from trunk_msgs_util.parameters.declarations import parameter

from .controller_config import ControllerConfig
from .law import Sample
from .lqr import lqr_update
from .pid import Gains, PidLaw, PidState, Terms
from .pid_kind import constant_gains, law_of_pid_kind

_BODY = Body()


@dataclass(frozen=True)
class LqrConfig(ControllerConfig):
    """Parameters of the ``lqr`` node.

    The default gains are those of Table 5's trunk (``m l^2 = 0.5``, ``m g l = 4.905``) with the weights
    I_0 = 0.1 rad s, e_0 = 6 deg, w_0 = 1 rad/s, u_0 = 5 N m, from the Riccati equation in continuous time.
    """

    p: float = parameter(
        "gains.p", 61.7853, "Gain on the angle's error", unit="N m/rad", minimum=0.0, maximum=1e9
    )
    i: float = parameter(
        "gains.i", 50.0, "Gain on its integral", unit="N m/(rad s)", minimum=0.0, maximum=1e9
    )
    d: float = parameter(
        "gains.d", 9.31586, "Gain on its rate", unit="N m s/rad", minimum=0.0, maximum=1e9
    )
    gravity_torque: float = parameter(
        "model.gravity_torque",
        _BODY.trunk_mass * _BODY.gravity * _BODY.length,
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
    def constants(self) -> tuple[Gains, float]:
        """The gains, and G."""
        return self.gains, self.gravity_torque

    @property
    def damping_gain(self) -> float:
        """The gain on the rate, N m s/rad."""
        return self.d


def update(
    state: PidState, sample: Sample, constants: tuple[Gains, float], law: PidLaw
) -> tuple[PidState, Terms]:
    """Return one update of `lqr_update`."""
    s = sample
    return lqr_update(
        state, s.reference, s.measurement, s.rate, s.dt, constants[0], constants[1], law
    )


LAW = law_of_pid_kind("lqr", "LQR", LqrConfig, update, constant_gains)
