"""Every parameter that all controllers share, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any

from trunk_msgs_util.parameters.config import lockstep_parameter, rate_parameter
from trunk_msgs_util.parameters.declarations import (
    ParameterError,
    check_together,
    parameter,
)
from trunk_msgs_util.units import nanoseconds

from .limits import Limits
from .reference import ReferenceConfig

DERIVATIVE_MODES = ("error", "measurement", "rate")
ANTIWINDUP_STRATEGIES = ("none", "conditional_integration", "back_calculation")


@dataclass(frozen=True)
class ControllerConfig(ReferenceConfig):
    """What every controller declares: its rate, joint, reference, derivative and limits."""

    update_rate: float = rate_parameter("Rate of the control law, measured by the states' stamps")
    lockstep: bool = lockstep_parameter(
        "Answer every state; between updates, repeat the last command"
    )
    derivative_mode: str = parameter(
        "derivative_mode",
        "rate",
        "The derivative of the error, of the measurement, or the measured rate (a gyro)",
        choices=DERIVATIVE_MODES,
    )
    derivative_filter_time: float = parameter(
        "derivative_filter_time",
        0.0,
        "Time constant of the derivative's filter; 0: none",
        unit="s",
        minimum=0.0,
        maximum=1e3,
    )
    u_clamp_max: float = parameter(
        "u_clamp_max", 100.0, "Upper limit of the command", unit="N m", unbounded=True
    )
    u_clamp_min: float = parameter(
        "u_clamp_min", -100.0, "Lower limit of the command", unit="N m", unbounded=True
    )
    i_clamp_max: float = parameter(
        "i_clamp_max",
        inf,
        "Upper limit of the integral term",
        unit="N m",
        minimum=0.0,
        unbounded=True,
    )
    i_clamp_min: float = parameter(
        "i_clamp_min",
        -inf,
        "Lower limit of the integral term",
        unit="N m",
        maximum=0.0,
        unbounded=True,
    )
    antiwindup_strategy: str = parameter(
        "antiwindup_strategy",
        "conditional_integration",
        "What the integral does while the command is limited",
        choices=ANTIWINDUP_STRATEGIES,
    )
    tracking_time_constant: float = parameter(
        "tracking_time_constant",
        0.0,
        "Time constant of back-calculation; 0: sqrt(kd / ki)",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )
    active_times: tuple[float, ...] = parameter(
        "active.times",
        (),
        "Times at which the controller becomes active, inactive, active ...; empty: always active",
        unit="s",
        element=float,
        minimum=0.0,
        maximum=1e6,
        fixed=True,
    )
    handover_step: float = parameter(
        "handover.max_step",
        1.0,
        "After a takeover the command moves by at most this per update until it meets the law's",
        unit="N m",
        above=0.0,
        unbounded=True,
    )

    max_gap_periods: int = parameter(
        "gap.max_periods",
        100,
        "After more periods without a state, by the stamps, start afresh as after a reset; 0: never",
        minimum=0,
        maximum=1_000_000,
    )

    def __post_init__(self) -> None:
        if not self.u_clamp_max > self.u_clamp_min:
            raise ParameterError(
                "u_clamp_max",
                self.u_clamp_max,
                f"it must be greater than u_clamp_min ({self.u_clamp_min:g})",
            )
        super().__post_init__()
        check_together(self)
        if any(b <= a for a, b in pairwise(self.active_times)):
            raise ParameterError("active.times", self.active_times, "strictly ascending times")

    @property
    def active_times_ns(self) -> tuple[int, ...]:
        """`active_times` in ns."""
        return tuple(nanoseconds(t) for t in self.active_times)

    @property
    def hip(self) -> str | None:
        """The hip's joint, where the law uses its motion."""
        return None

    @property
    def uses_rate(self) -> bool:
        """True if the law uses the measured rate; a state without it is then not answered."""
        return self.derivative_mode == "rate" or self.hip is not None

    @property
    def damping_gain(self) -> float:
        """The largest gain on the rate, N m s/rad: it bounds the sampled loop's period."""
        return 0.0

    @property
    def constants(self) -> tuple[Any, ...]:
        """What the law's functions take besides the sample; each law defines it."""
        raise NotImplementedError

    @property
    def limits(self) -> Limits:
        """What stays fixed while gains change."""
        return Limits(
            DERIVATIVE_MODES.index(self.derivative_mode),
            self.derivative_filter_time,
            self.u_clamp_min,
            self.u_clamp_max,
            self.i_clamp_min,
            self.i_clamp_max,
            ANTIWINDUP_STRATEGIES.index(self.antiwindup_strategy),
            self.tracking_time_constant,
        )
