"""The law ``pid``: a sampled PID with three derivative modes, filter, limits, anti-windup.

Its update is pure: CPython runs it and numba compiles it unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass

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

AS_PRINTED, ZIEGLER_NICHOLS = Gains(60.0, 36.0, 400.0), Gains(60.0, 100.0, 9.0)


@dataclass(frozen=True)
class PidConfig(WithGains, ControllerConfig):
    """Parameters of the ``pid`` node. The default gains are Ziegler-Nichols', Ku = 100, Tu = 1.2 s."""

    p: float = gain("p", 60.0, "Proportional gain", "N m/rad")
    i: float = gain("i", 100.0, "Integral gain", "N m/(rad s)")
    d: float = gain("d", 9.0, "Derivative gain", "N m s/rad")

    @property
    def constants(self) -> tuple[Gains]:
        """The gains."""
        return (self.gains,)


def pid_update(
    state: PidState,
    reference: float,
    measurement: float,
    rate: float,
    dt: float,
    gains: Gains,
    limits: Limits,
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of one PID update (paper, eq. 13).

    ``reference`` and ``measurement`` in rad, ``rate`` (measured, used only by mode "rate") in rad/s,
    ``dt`` in s since the previous update. ``dt <= 0``, a non-finite sample, or a law whose result would
    not be finite holds the last command and leaves the state unchanged.
    """
    error = reference - measurement
    if not usable(error, rate, dt):
        return held(state, gains, alpha_of(gains), limits)
    derivative = error_derivative(state, error, measurement, rate, dt, limits)
    return combine(state, error, measurement, derivative, dt, gains, alpha_of(gains), limits, 0.0)


def update(
    state: PidState, sample: Sample, constants: tuple[Gains], limits: Limits
) -> tuple[PidState, Terms]:
    """Return one update of `pid_update`."""
    s = sample
    return pid_update(state, s.reference, s.measurement, s.rate, s.dt, constants[0], limits)


def describe(config: PidConfig) -> str:
    """Return the origin of these gains, or their values."""
    if config.gains == AS_PRINTED:
        return "gains as printed"
    if config.gains == ZIEGLER_NICHOLS:
        return "Ziegler–Nichols"
    return "{:g}, {:g}, {:g}".format(*config.gains)


LAW = law_of_pid_family("pid", "PID", PidConfig, update, constant_gains, describe)
