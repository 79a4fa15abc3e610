"""The law ``lqr``: state feedback with integral action, plus the torque that holds the reference.

Its structure is that of a PID with feed-forward; only the origin of the gains differs. With the hip's
motion prescribed and the trunk upright, the plant is ``m l^2 theta'' = m g l theta + tau``; the gains
minimise ``integral (I^2 / I_0^2 + e^2 / e_0^2 + e'^2 / w_0^2 + u^2 / u_0^2) dt`` for its states I, e, e'.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass

from trunk_core.elementary import sin
from trunk_core.mechanics import Body
from trunk_core.parameters.declarations import parameter

from .law import ControllerConfig, Limits, Sample
from .pid_family import (
    Gains,
    PidState,
    Terms,
    WithGains,
    alpha_of,
    combine,
    constant_gains,
    error_derivative,
    gain,
    held,
    law_of_pid_family,
    usable,
)

_BODY = Body()


@dataclass(frozen=True)
class LqrConfig(WithGains, ControllerConfig):
    """Parameters of the ``lqr`` node.

    The default gains are those of Table 5's trunk (``m l^2 = 0.5``, ``m g l = 4.905``) with the weights
    I_0 = 0.1 rad s, e_0 = 6 deg, w_0 = 1 rad/s, u_0 = 5 N m, from the Riccati equation in continuous time.
    """

    p: float = gain("p", 61.7853, "Gain on the angle's error", "N m/rad")
    i: float = gain("i", 50.0, "Gain on its integral", "N m/(rad s)")
    d: float = gain("d", 9.31586, "Gain on its rate", "N m s/rad")
    gravity_torque: float = parameter(
        "model.gravity_torque",
        _BODY.trunk_mass * _BODY.gravity * _BODY.length,
        "G = m g l of the torque -G sin(reference) that holds the trunk there; 0: no feed-forward",
        unit="N m",
        minimum=0.0,
        maximum=1e9,
    )

    @property
    def constants(self) -> tuple[Gains, float]:
        """The gains, and G."""
        return self.gains, self.gravity_torque


def lqr_update(
    state: PidState, sample: Sample, constants: tuple[Gains, float], limits: Limits
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = kp e + ki I + kd D - G sin(reference)``.

    ``constants``: the gains, and G = m g l in N m, gravity's torque on a level trunk. The feed-forward is
    the command minus the three terms. Holds as `pid_update` does.
    """
    gains, gravity_torque = constants
    reference, measurement, rate, dt, _ = sample
    error = reference - measurement
    if not usable(error, rate, dt):
        return held(state, gains, alpha_of(gains), limits)
    derivative = error_derivative(state, error, measurement, rate, dt, limits)
    return combine(
        state,
        error,
        measurement,
        derivative,
        dt,
        gains,
        alpha_of(gains),
        limits,
        -gravity_torque * sin(reference),
    )


LAW = law_of_pid_family("lqr", "LQR", LqrConfig, lqr_update, constant_gains)
