"""The law ``state_feedback``: a gain on each coordinate and on each rate, with integral action.

It holds the controlled coordinate at the reference, as a PID does, and the other one at 0: the cart of a
pole, which ``lqr`` leaves where it is. As with ``lqr``, the gains come from a Riccati equation.

Pure: scalar functions of floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from trunk_core.parameters.declarations import parameter

from .law import ControllerConfig, Hip, Limits, Sample
from .lqr import LqrConfig
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
    rescaled,
    usable,
)

Constants = tuple[Gains, float, float]


def _signed(name: str, default: float, description: str, unit: str) -> Any:
    """Return the declaration of a gain of either sign."""
    name = f"gains.{name}"
    return parameter(name, default, description, unit=unit, minimum=-1e9, maximum=1e9)


@dataclass(frozen=True)
class StateFeedbackConfig(WithGains, ControllerConfig):
    """Parameters of the ``state_feedback`` node.

    The default gains are those of ``lqr``, and none on the hip: they hold the trunk.
    """

    hip_joint: str = parameter(
        "hip_joint", "hip", "The joint of the other coordinate, which is held at 0", fixed=True
    )
    p: float = _signed("p", LqrConfig.p, "Gain on the angle's error", "N m/rad")
    i: float = gain("i", LqrConfig.i, "Gain on its integral", "N m/(rad s)")
    d: float = _signed("d", LqrConfig.d, "Gain on its rate", "N m s/rad")
    x: float = _signed("x", 0.0, "Gain on the other coordinate", "N m/m")
    v: float = _signed("v", 0.0, "Gain on its rate", "N m s/m")

    @property
    def constants(self) -> Constants:
        """The gains of the error, then those of the other coordinate and its rate."""
        return self.gains, self.x, self.v

    @property
    def hip(self) -> str:
        """The joint of the other coordinate."""
        return self.hip_joint

    @property
    def hip_gains(self) -> tuple[float, float]:
        """The gains of the other coordinate and its rate."""
        return self.x, self.v


def hip_feedback(hip: Hip, constants: Constants) -> float:
    """Return ``-(kx q + kv q')`` of the other coordinate q, N m."""
    _, x, v = constants
    return -(x * hip.position + v * hip.velocity)


def state_feedback_update(
    state: PidState, sample: Sample, constants: Constants, limits: Limits
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of ``u = kp e + ki I + kd D - (kx q + kv q')``.

    ``e = reference - measurement``; q, q' are `Sample.hip`. So kp, kd, kx, kv are the gains K of
    ``u = -K z`` for z = (angle, rate, q, q') and the reference 0. The part of q is the command minus the
    three terms. Holds as `pid_update` does.
    """
    gains = constants[0]
    reference, measurement, rate, dt, hip = sample
    error, feedback = reference - measurement, hip_feedback(hip, constants)
    if not usable(error, rate + feedback, dt):
        return held(state, gains, alpha_of(gains), limits)
    derivative = error_derivative(state, error, measurement, rate, dt, limits)
    return combine(
        state, error, measurement, derivative, dt, gains, alpha_of(gains), limits, feedback
    )


def reconfigure(state: PidState, sample: Sample, before: Constants, after: Constants) -> PidState:
    """Return the state with its integral rescaled, as `rescaled` does; it takes up the hip's part, too."""
    state = rescaled(state, before[0], after[0])
    if not state.started or after[0].i == 0.0 or before == after:
        return state
    change = hip_feedback(sample.hip, before) - hip_feedback(sample.hip, after)
    integral = state.integral + change / after[0].i
    return state._replace(integral=integral) if integral - integral == 0.0 else state


LAW = replace(
    law_of_pid_family(
        "state_feedback",
        "State feedback",
        StateFeedbackConfig,
        state_feedback_update,
        constant_gains,
    ),
    reconfigure=reconfigure,
)
