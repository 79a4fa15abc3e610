"""The law ``fuzzy_pid``: a PID whose gains are inferred at each sample from (e, e_dot).

Its functions are pure: CPython runs them and numba compiles them unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any, NamedTuple

from trunk_core.parameters.declarations import parameter

from . import rule_tables
from .fuzzy import FiredRule, FuzzyCell, FuzzyRules, cell_at, fired_rules, infer, rules_of
from .law import ControllerConfig, Limits, Lookup, Sample
from .pid_family import (
    Gains,
    PidState,
    Terms,
    combine,
    error_derivative,
    error_inputs,
    held,
    law_of_pid_family,
    usable,
)
from .rule_base import (
    RuleBaseConfig,
    centers_parameter,
    labels_parameter,
    rule_table,
    table_parameter,
)
from .rule_tables import RuleTable


class GainBox(NamedTuple):
    """Ranges of the inferred gains: [0.32, 0.60] Ku and [0.08, 0.15] Ku Tu (paper, eq. 16, corrected)."""

    p_min: float = 32.0  # N m/rad
    p_max: float = 60.0  # N m/rad
    d_min: float = 9.6  # N m s/rad
    d_max: float = 18.0  # N m s/rad


def _range_gain(
    name: str, default: float, description: str, unit: str, at_least: str = ""
) -> float:
    gain: float = parameter(
        name, default, description, unit=unit, above=0.0, maximum=1e9, at_least=at_least
    )
    return gain


@dataclass(frozen=True)
class GainRangesConfig(ControllerConfig):
    """The ranges of the inferred gains. The defaults are the paper's eq. 16, corrected."""

    p_min: float = _range_gain("gains.p_min", 32.0, "Kp where Kp' = 0: 0.32 Ku", "N m/rad")
    p_max: float = _range_gain(
        "gains.p_max", 60.0, "Kp where Kp' = 1: 0.60 Ku", "N m/rad", "gains.p_min"
    )
    d_min: float = _range_gain("gains.d_min", 9.6, "Kd where Kd' = 0: 0.08 Ku Tu", "N m s/rad")
    d_max: float = _range_gain(
        "gains.d_max", 18.0, "Kd where Kd' = 1: 0.15 Ku Tu", "N m s/rad", "gains.d_min"
    )


@dataclass(frozen=True)
class FuzzyPidConfig(RuleBaseConfig, GainRangesConfig):
    """Parameters of the ``fuzzy_pid`` node."""

    kp_labels: tuple[str, ...] = labels_parameter(
        "fuzzy.kp_labels", rule_tables.GAIN_LABELS, "Labels of Kp'"
    )
    kp_centers: tuple[float, ...] = centers_parameter(
        "fuzzy.kp_centers",
        rule_tables.GAIN_CENTERS,
        "Centres of Kp's labels",
        minimum=0.0,
        maximum=1.0,
    )
    kd_labels: tuple[str, ...] = labels_parameter(
        "fuzzy.kd_labels", rule_tables.GAIN_LABELS, "Labels of Kd'"
    )
    kd_centers: tuple[float, ...] = centers_parameter(
        "fuzzy.kd_centers",
        rule_tables.GAIN_CENTERS,
        "Centres of Kd's labels",
        minimum=0.0,
        maximum=1.0,
    )
    alpha_labels: tuple[str, ...] = labels_parameter(
        "fuzzy.alpha_labels", rule_tables.ALPHA_LABELS, "Labels of alpha"
    )
    alpha_centers: tuple[float, ...] = centers_parameter(
        "fuzzy.alpha_centers",
        rule_tables.ALPHA_CENTERS,
        "Centres of alpha's labels",
        above=0.0,
        maximum=1e6,
    )
    consequents: str = parameter(
        "fuzzy.consequents",
        "linear",
        "Consequents of Kp' and Kd': their centres, or Zhao's logarithmic memberships",
        choices=("linear", "log"),
    )
    rules_kp: tuple[str, ...] = table_parameter(
        "rules.kp",
        rule_tables.KP_AS_PRINTED,
        "Table 2: Kp', a row per label of e, a label or number per label of e_dot",
    )
    rules_kd: tuple[str, ...] = table_parameter(
        "rules.kd",
        rule_tables.KD_AS_PRINTED,
        "Table 3: Kd', a row per label of e, a label or number per label of e_dot",
    )
    rules_alpha: tuple[str, ...] = table_parameter(
        "rules.alpha",
        rule_tables.ALPHA_AS_PRINTED,
        "Table 4: alpha, a row per label of e, a label or number per label of e_dot",
    )

    @property
    def tables(self) -> tuple[RuleTable, ...]:
        """The tables of Kp', Kd' and alpha."""
        unit, positive = rule_tables.UNIT, rule_tables.POSITIVE
        return (
            rule_table("kp", self.rules_kp, self.kp_labels, self.kp_centers, unit),
            rule_table("kd", self.rules_kd, self.kd_labels, self.kd_centers, unit),
            rule_table("alpha", self.rules_alpha, self.alpha_labels, self.alpha_centers, positive),
        )

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
        axes = self.axes
        kp, kd, alpha = (table.values(axes) for table in self.tables)
        return FuzzyRules(*self.peaks, kp, kd, alpha, self.consequents == "log")

    @property
    def inference(self) -> Callable[[float, float], tuple[float, ...]]:
        """``(Kp', Kd', alpha)`` as a function of e in rad and e_dot in rad/s."""
        return partial(infer, rules=self.rules)

    def fired(self, error: float, rate: float) -> tuple[FiredRule, ...]:
        """Return the four rules that fire at e in rad and e_dot in rad/s."""
        return fired_rules(error, rate, self.rules)

    @property
    def constants(self) -> tuple[FuzzyRules, GainBox]:
        """The rules and the ranges."""
        return self.rules, self.box


def inferred_gains(
    error: float, error_rate: float, rules: FuzzyRules, box: GainBox
) -> tuple[Gains, float]:
    """Return ``(gains, alpha)`` at the inputs [rad, rad/s] (paper, eqs. 14 to 16).

    ::

        Kp = Kp,min + (Kp,max - Kp,min) Kp'      Kd likewise      Ki = Kp^2 / (alpha Kd)

    Kp and Kd never leave the box, not even by rounding.
    """
    kp_scaled, kd_scaled, alpha = infer(error, error_rate, rules)
    kp = box.p_min + (box.p_max - box.p_min) * kp_scaled
    kd = box.d_min + (box.d_max - box.d_min) * kd_scaled
    if kp > box.p_max:
        kp = box.p_max
    elif kp < box.p_min:
        kp = box.p_min
    if kd > box.d_max:
        kd = box.d_max
    elif kd < box.d_min:
        kd = box.d_min
    scale = alpha * kd
    ki = kp * kp / scale if scale != 0.0 else inf  # it may underflow to 0
    return Gains(kp, ki, kd), alpha


def fuzzy_pid_update(
    state: PidState, sample: Sample, constants: tuple[FuzzyRules, GainBox], limits: Limits
) -> tuple[PidState, Terms]:
    """Return the next state and the terms of one Fuzzy-PID update; ``constants``: the rules and ranges.

    The gains are inferred at (e_k, D_k), with the derivative that the law uses, and applied to the same
    sample: ``u = Kp e + Ki I + Kd D`` with Ki outside the sum. Holds as `pid_update` does.
    """
    rules, box = constants
    reference, measurement, rate, dt, _ = sample
    error = reference - measurement
    if not usable(error, rate, dt):
        gains, alpha = inferred_gains(state.error, state.derivative, rules, box)
        return held(state, gains, alpha, limits)
    derivative = error_derivative(state, error, measurement, rate, dt, limits)
    gains, alpha = inferred_gains(error, derivative, rules, box)
    return combine(state, error, measurement, derivative, dt, gains, alpha, limits, 0.0)


def last_gains(state: PidState, sample: Sample, constants: tuple[FuzzyRules, GainBox]) -> Gains:
    """Return the gains inferred at the last error and its rate."""
    return inferred_gains(state.error, state.derivative, constants[0], constants[1])[0]


def cell(error: float, error_rate: float, constants: tuple[FuzzyRules, GainBox]) -> Any:
    """Return the four rules that fire."""
    return cell_at(error, error_rate, constants[0])


def near(rules_near: Any, constants: tuple[FuzzyRules, GainBox]) -> tuple[FuzzyRules, GainBox]:
    """Return the constants with only these four rules."""
    return rules_of(rules_near, constants[0]), constants[1]


def describe(config: FuzzyPidConfig) -> str:
    """Return a note if the rules are not the shipped ones, else nothing."""
    return "custom rules" if config.rules != FuzzyPidConfig().rules else ""


LOOKUP = Lookup(error_inputs, cell, near, FuzzyCell)
LAW = law_of_pid_family(
    "fuzzy_pid", "Fuzzy-PID", FuzzyPidConfig, fuzzy_pid_update, last_gains, describe, LOOKUP
)
