"""Every parameter of the controllers, declared once: what all share, the PID's, the Fuzzy-PID's."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import inf, pi

from trunk_msgs_util.config import ManagedConfig
from trunk_msgs_util.declarations import ParameterError, parameter
from trunk_msgs_util.units import nanoseconds, period_ns

from . import rule_tables
from .fuzzy import FuzzyRules
from .fuzzy_pid import GainBox
from .pid import Gains, PidLaw
from .reference import CONSTANT, PROFILES, ReferenceProfile

DERIVATIVE_MODES = ("error", "measurement", "rate")
ANTIWINDUP_STRATEGIES = ("none", "conditional_integration", "back_calculation")
_EVEN_PEAKS = tuple(i / 3.0 for i in range(-3, 4))


@dataclass(frozen=True)
class ControllerConfig(ManagedConfig):
    """What every controller declares: its rate, joint, reference, derivative and limits."""

    update_rate: float = parameter(
        "update_rate",
        200.0,
        "Rate of the control law, in the time of the states' stamps",
        unit="Hz",
        minimum=0.001,
        maximum=1e6,
        fixed=True,
    )
    lockstep: bool = parameter(
        "lockstep.enabled",
        False,
        "Answer every state, between due ones with the held command",
        fixed=True,
    )
    joint: str = parameter("joint", "trunk", "The joint that is controlled", fixed=True)
    reference_profile: str = parameter(
        "reference.profile",
        "constant",
        "Shape of the reference; topic: the newest message on the reference topic, before it the value",
        choices=(*PROFILES, "topic"),
    )
    reference_value: float = parameter(
        "reference.value",
        0.0,
        "Constant, final value of the step, or mean of the sine",
        unit="rad",
        minimum=-1e3,
        maximum=1e3,
    )
    reference_initial: float = parameter(
        "reference.initial",
        0.0,
        "Before the step, or before the sequence begins",
        unit="rad",
        minimum=-1e3,
        maximum=1e3,
    )
    reference_step_time: float = parameter(
        "reference.step_time", 2.0, "When the step comes", unit="s", minimum=0.0, maximum=1e6
    )
    reference_amplitude: float = parameter(
        "reference.amplitude", 0.0, "Amplitude of the sine", unit="rad", minimum=-1e3, maximum=1e3
    )
    reference_frequency: float = parameter(
        "reference.frequency", 0.5, "Frequency of the sine", unit="Hz", minimum=0.0, maximum=1e5
    )
    reference_times: tuple[float, ...] = parameter(
        "reference.times",
        (),
        "When the levels of the sequence begin, ascending",
        unit="s",
        element=float,
        longest=10_000,
        minimum=0.0,
        maximum=1e6,
    )
    reference_values: tuple[float, ...] = parameter(
        "reference.values",
        (),
        "The levels of the sequence",
        unit="rad",
        element=float,
        longest=10_000,
        minimum=-1e3,
        maximum=1e3,
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
        "When the controller turns active, inactive, active ... in the states' time; empty: always active",
        unit="s",
        element=float,
        minimum=0.0,
        maximum=1e6,
        fixed=True,
    )
    handover_step: float = parameter(
        "handover.max_step",
        1.0,
        "Having taken over, the command moves by at most this per update until it meets the law's",
        unit="N m",
        above=0.0,
        unbounded=True,
    )

    def __post_init__(self) -> None:
        if not self.u_clamp_max > self.u_clamp_min:
            raise ParameterError(
                "u_clamp_max", self.u_clamp_max, f"greater than u_clamp_min ({self.u_clamp_min:g})"
            )
        if len(self.reference_values) != len(self.reference_times):
            raise ParameterError(
                "reference.values",
                self.reference_values,
                f"as many as reference.times ({len(self.reference_times)})",
            )
        if list(self.reference_times) != sorted(self.reference_times):
            raise ParameterError("reference.times", self.reference_times, "ascending times")
        if any(b <= a for a, b in pairwise(self.active_times)):
            raise ParameterError("active.times", self.active_times, "strictly ascending times")

    @property
    def period_ns(self) -> int:
        """The control period in ns."""
        return period_ns(self.update_rate)

    @property
    def active_times_ns(self) -> tuple[int, ...]:
        """`active_times` in ns."""
        return tuple(nanoseconds(t) for t in self.active_times)

    @property
    def hip(self) -> str | None:
        """The hip's joint, where the law uses its motion."""
        return None

    @property
    def damping_gain(self) -> float:
        """The largest gain of the rate, N m s/rad: it bounds the period of the sampled loop."""
        return 0.0

    @property
    def law(self) -> PidLaw:
        """What stays fixed while gains move."""
        return PidLaw(
            DERIVATIVE_MODES.index(self.derivative_mode),
            self.derivative_filter_time,
            self.u_clamp_min,
            self.u_clamp_max,
            self.i_clamp_min,
            self.i_clamp_max,
            ANTIWINDUP_STRATEGIES.index(self.antiwindup_strategy),
            self.tracking_time_constant,
        )

    @property
    def reference(self) -> ReferenceProfile:
        """The profile that `reference_at` evaluates."""
        return ReferenceProfile(
            CONSTANT
            if self.reference_profile == "topic"
            else PROFILES.index(self.reference_profile),
            self.reference_value,
            self.reference_initial,
            nanoseconds(self.reference_step_time),
            self.reference_amplitude,
            self.reference_frequency,
            tuple(nanoseconds(t) for t in self.reference_times),
            self.reference_values,
        )


@dataclass(frozen=True)
class PidConfig(ControllerConfig):
    """Parameters of the ``pid`` node. The default gains are Ziegler-Nichols', Ku = 100, Tu = 1.2 s."""

    p: float = parameter(
        "gains.p", 60.0, "Proportional gain", unit="N m/rad", minimum=0.0, maximum=1e9
    )
    i: float = parameter(
        "gains.i", 100.0, "Integral gain", unit="N m/(rad s)", minimum=0.0, maximum=1e9
    )
    d: float = parameter(
        "gains.d", 9.0, "Derivative gain", unit="N m s/rad", minimum=0.0, maximum=1e9
    )

    @property
    def gains(self) -> Gains:
        """The gains."""
        return Gains(self.p, self.i, self.d)

    @property
    def damping_gain(self) -> float:
        """Kd."""
        return self.d


def _range_gain(name: str, default: float, description: str, unit: str) -> float:
    gain: float = parameter(name, default, description, unit=unit, above=0.0, maximum=1e9)
    return gain


def _peaks(name: str, description: str) -> tuple[float, ...]:
    peaks: tuple[float, ...] = parameter(
        name, _EVEN_PEAKS, description, length=len(_EVEN_PEAKS), minimum=-1.0, maximum=1.0
    )
    return peaks


def _table(name: str, default: tuple[str, ...], description: str) -> tuple[str, ...]:
    rows: tuple[str, ...] = parameter(name, default, description, length=len(default))
    return rows


@dataclass(frozen=True)
class FuzzyPidConfig(ControllerConfig):
    """Parameters of the ``fuzzy_pid`` node. The default ranges are the paper's eq. 16, corrected."""

    p_min: float = _range_gain("gains.p_min", 32.0, "Kp where Kp' = 0: 0.32 Ku", "N m/rad")
    p_max: float = _range_gain("gains.p_max", 60.0, "Kp where Kp' = 1: 0.60 Ku", "N m/rad")
    d_min: float = _range_gain("gains.d_min", 9.6, "Kd where Kd' = 0: 0.08 Ku Tu", "N m s/rad")
    d_max: float = _range_gain("gains.d_max", 18.0, "Kd where Kd' = 1: 0.15 Ku Tu", "N m s/rad")
    error_range: float = parameter(
        "fuzzy.error_range", pi / 2.0, "Universe of e: +- this", unit="rad", above=0.0, maximum=1e3
    )
    rate_range: float = parameter(
        "fuzzy.rate_range", 5.0, "Universe of e_dot: +- this", unit="rad/s", above=0.0, maximum=1e5
    )
    error_peaks: tuple[float, ...] = _peaks(
        "fuzzy.error_peaks", "Peaks of e's triangles NB ... PB, as parts of the universe, ascending"
    )
    rate_peaks: tuple[float, ...] = _peaks(
        "fuzzy.rate_peaks",
        "Peaks of e_dot's triangles NB ... PB, as parts of the universe, ascending",
    )
    alpha_centers: tuple[float, ...] = parameter(
        "fuzzy.alpha_centers",
        (2.0, 3.0, 4.0, 5.0),
        "Centres of alpha's labels S, MS, M, B",
        length=4,
        above=0.0,
        maximum=1e6,
    )
    consequents: str = parameter(
        "fuzzy.consequents",
        "linear",
        "Consequents of Kp' and Kd': their centres, or Zhao's logarithmic memberships",
        choices=("linear", "log"),
    )
    rules_kp: tuple[str, ...] = _table(
        "rules.kp", rule_tables.KP_AS_PRINTED, "Table 2: a row of labels S, B per label of e"
    )
    rules_kd: tuple[str, ...] = _table(
        "rules.kd", rule_tables.KD_AS_PRINTED, "Table 3: a row of labels S, B per label of e"
    )
    rules_alpha: tuple[str, ...] = _table(
        "rules.alpha",
        rule_tables.ALPHA_AS_PRINTED,
        "Table 4: a row of labels S, MS, M, B per label of e",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high, name in (
            (self.p_min, self.p_max, "gains.p_max"),
            (self.d_min, self.d_max, "gains.d_max"),
        ):
            if high < low:
                raise ParameterError(name, high, f"at least {name.replace('max', 'min')} ({low:g})")
        for peaks, name in (
            (self.error_peaks, "fuzzy.error_peaks"),
            (self.rate_peaks, "fuzzy.rate_peaks"),
        ):
            if any(b <= a for a, b in pairwise(peaks)):
                raise ParameterError(name, peaks, "strictly increasing peaks")
        for rows, name in (
            (self.rules_kp, "rules.kp"),
            (self.rules_kd, "rules.kd"),
            (self.rules_alpha, "rules.alpha"),
        ):
            try:
                rule_tables.centers(rows, self._centers_of(name))
            except ValueError as error:
                raise ParameterError(name, rows, str(error)) from None

    def _centers_of(self, name: str) -> dict[str, float]:
        if name == "rules.alpha":
            return dict(zip(rule_tables.ALPHA_LABELS, self.alpha_centers, strict=True))
        return dict(rule_tables.GAIN_CENTERS)

    @property
    def damping_gain(self) -> float:
        """The largest Kd of the box."""
        return self.d_max

    @property
    def box(self) -> GainBox:
        """The ranges of Kp and Kd."""
        return GainBox(self.p_min, self.p_max, self.d_min, self.d_max)

    @property
    def rules(self) -> FuzzyRules:
        """The rule base, with its peaks in rad and rad/s."""
        return FuzzyRules(
            tuple(self.error_range * peak for peak in self.error_peaks),
            tuple(self.rate_range * peak for peak in self.rate_peaks),
            rule_tables.centers(self.rules_kp, self._centers_of("rules.kp")),
            rule_tables.centers(self.rules_kd, self._centers_of("rules.kd")),
            rule_tables.centers(self.rules_alpha, self._centers_of("rules.alpha")),
            self.consequents == "log",
        )
