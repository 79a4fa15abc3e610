"""The law ``fuzzy``: a rule table of (e, e_dot) gives the torque itself, or how fast it changes.

Its functions are pure: CPython runs them and numba compiles them unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from trunk_core.parameters.declarations import parameter

from .fuzzy import FiredRule, bilinear, cell_edges, cell_kind, fired_at, four_rules, locate
from .law import Law, Limits, Lookup, Sample, limited
from .pid_family import Gains, PidState, combine, error_derivative, error_inputs, usable
from .rule_base import (
    RuleBaseConfig,
    centers_parameter,
    labels_parameter,
    rule_table,
    table_parameter,
)
from .rule_tables import FRACTION, INPUT_LABELS, MACVICAR_WHELAN, RuleTable

_THIRDS = tuple(i / 3.0 for i in range(-3, 4))


class TorqueRules(NamedTuple):
    """A rule base with one output, a fraction from -1 to 1; as `fuzzy.FuzzyRules` otherwise."""

    error_peaks: Sequence[float]  # rad
    rate_peaks: Sequence[float]  # rad/s
    table: Sequence[float]


TorqueCell = cell_kind("u")


class FuzzyTerms(NamedTuple):
    """One update, term by term."""

    error: float  # rad
    error_rate: float  # the derivative that was used, rad/s
    output: float  # of the table, from -1 to 1
    table_term: float  # N m; 0 in the form pi
    integral: float  # N m; 0 in the form pd
    unsaturated: float  # N m
    effort: float  # N m, after the limits
    held: bool


Constants = tuple[TorqueRules, float, bool]  # rules, scale, integrating


@dataclass(frozen=True)
class FuzzyConfig(RuleBaseConfig):
    """Parameters of the ``fuzzy`` node.

    Near the upright the default table is a PD controller with the gains scale / error_range (57.3 N m/rad)
    and scale / rate_range (18 N m s/rad).
    """

    output_labels: tuple[str, ...] = labels_parameter(
        "fuzzy.output_labels", INPUT_LABELS, "Labels of the output"
    )
    output_centers: tuple[float, ...] = centers_parameter(
        "fuzzy.output_centers",
        _THIRDS,
        "Centres of the output's labels, as fractions of its scale",
        minimum=-1.0,
        maximum=1.0,
    )
    output_scale: float = parameter(
        "fuzzy.output_scale",
        90.0,
        "Torque (form pd), or its change in a second (form pi), where the table gives 1",
        unit_by="fuzzy.form",
        unit="N m or N m/s",
        units=(("pd", "N m"), ("pi", "N m/s")),
        above=0.0,
        maximum=1e9,
    )
    form: str = parameter(
        "fuzzy.form",
        "pd",
        "The table gives the torque, or its derivative, which is integrated",
        choices=("pd", "pi"),
    )
    rules_u: tuple[str, ...] = table_parameter(
        "rules.u", MACVICAR_WHELAN, "A row per label of e, a label or number per label of e_dot"
    )

    @property
    def tables(self) -> tuple[RuleTable, ...]:
        """The one table."""
        return (
            rule_table(
                "u", self.rules_u, self.output_labels, self.output_centers, FRACTION, "output"
            ),
        )

    @property
    def rules(self) -> TorqueRules:
        """The rule base, with its peaks in rad and rad/s."""
        return TorqueRules(*self.peaks, self.tables[0].values(self.axes))

    @property
    def inference(self) -> Callable[[float, float], tuple[float, ...]]:
        """The table's output as a function of e in rad and e_dot in rad/s."""
        rules = self.rules
        return lambda error, rate: (table_output(error, rate, rules),)

    def fired(self, error: float, rate: float) -> tuple[FiredRule, ...]:
        """Return the four rules that fire at e in rad and e_dot in rad/s."""
        rules = self.rules
        columns = len(rules.rate_peaks)
        return tuple(
            rule._replace(values=(rules.table[rule.row * columns + rule.column],))
            for rule in fired_at(error, rate, rules.error_peaks, rules.rate_peaks)
        )

    @property
    def constants(self) -> Constants:
        """The rules, the scale, and whether the output is integrated."""
        return self.rules, self.output_scale, self.form == "pi"

    @property
    def damping_gain(self) -> float:
        """The steepest slope of the torque over the rate; 0 in the form pi."""
        if self.form == "pi":
            return 0.0
        _, peaks, table = self.rules
        columns = len(peaks)
        slopes = (
            (table[cell + 1] - table[cell]) / (peaks[cell % columns + 1] - peaks[cell % columns])
            for cell in range(len(table))
            if cell % columns < columns - 1
        )
        return self.output_scale * max(0.0, *slopes)


def table_output(error: float, error_rate: float, rules: TorqueRules) -> float:
    """Return the table's output by product inference and centre average, as `fuzzy.infer` does."""
    i, a = locate(error, rules.error_peaks)
    j, b = locate(error_rate, rules.rate_peaks)
    columns = len(rules.rate_peaks)
    return bilinear(rules.table, i * columns + j, columns, a, b)


def fuzzy_update(
    state: PidState, sample: Sample, constants: Constants, limits: Limits
) -> tuple[PidState, FuzzyTerms]:
    """Return the next state and the terms of one update; ``constants``: rules, scale K, integrating.

    With the table's output f in [-1, 1]::

        form pd:  u_k = K f(e_k, D_k)                               K in N m
        form pi:  u_k = U_k = U_{k-1} + h K f(e_k, D_k)             K in N m/s

    U is ``state.integral``, here in N m; it stays within ``i_min`` and ``i_max``. Anti-windup acts
    afterwards, on the U of the next sample (`pid_family.combine`, with K f for e and ki = 1): conditional
    integration drops the increment where u is limited and ``u K f > 0``; back-calculation adds
    ``h (u_limited - u) / T_t``, where T_t = 0 means h.
    A sample that is not usable, and an overflow, are held. Source: D. Driankov, H. Hellendoorn, M. Reinfrank,
    An Introduction to Fuzzy Control, 1993, 3.3: PD-like and PI-like controllers.
    """
    rules, scale, integrating = constants
    reference, measurement, rate, dt, _ = sample
    error = reference - measurement
    if not usable(error, rate, dt):
        return fuzzy_held(state, limits)
    derivative = error_derivative(state, error, measurement, rate, dt, limits)
    output = table_output(error, derivative, rules)
    torque, change = scale * output, 0.0
    if integrating:
        torque, change = 0.0, torque
    # U is an integral with ki = 1 and no other term; the form pd has no U.
    gains = Gains(0.0, 1.0 if integrating else 0.0, 0.0)
    after, terms = combine(state, change, measurement, derivative, dt, gains, 0.0, limits, torque)
    if terms.held:
        return fuzzy_held(state, limits)
    u, effort = terms.unsaturated, terms.effort
    return (
        PidState(after.integral, error, measurement, derivative, effort, True),
        FuzzyTerms(error, derivative, output, torque, terms.i_term, u, effort, False),
    )


def fuzzy_held(state: PidState, limits: Limits) -> tuple[PidState, FuzzyTerms]:
    """Return the unchanged state, and terms that repeat the last command within the current limits."""
    effort = limited(state.effort, limits)
    return state, FuzzyTerms(
        state.error, state.derivative, 0.0, 0.0, 0.0, state.effort, effort, True
    )


def transfer(
    initial: PidState,
    seen: float,
    sample: Sample,
    effort: float,
    constants: Constants,
    limits: Limits,
) -> PidState:
    """Return the memory with which a moving plant is taken over: in the form pi, U goes on from the torque.

    The form pd has nothing that could absorb the difference: the command makes it up in bounded steps.
    """
    memory = PidState(0.0, sample.reference - seen, seen, 0.0, effort, True)
    if constants[2]:
        _, terms = fuzzy_update(memory, sample, constants, limits)
        integral = effort - terms.integral
        if integral - integral == 0.0:
            memory = PidState(integral, memory.error, seen, 0.0, effort, True)
    return memory


def reconfigure(memory: PidState, sample: Sample, before: Constants, after: Constants) -> PidState:
    """Return the memory under new constants: U has no gain in it, and begins at the last command."""
    if not memory.started or before[2] == after[2]:
        return memory
    integral = memory.effort if after[2] else 0.0
    return PidState(
        integral, memory.error, memory.measurement, memory.derivative, memory.effort, True
    )


def cell(error: float, error_rate: float, constants: Constants) -> Any:
    """Return the four rules that fire."""
    rules = constants[0]
    edges, corner = cell_edges(error, error_rate, rules.error_peaks, rules.rate_peaks)
    return TorqueCell(*edges, *four_rules(rules.table, corner, len(rules.rate_peaks)))


def near(rules_near: Any, constants: Constants) -> Constants:
    """Return the constants with only these four rules."""
    rules = TorqueRules(rules_near[4:6], rules_near[6:8], rules_near[8:12])
    return rules, constants[1], constants[2]


def describe(config: FuzzyConfig) -> str:
    """Return the form, and a note if the rules are not the shipped ones."""
    custom = ", custom rules" if config.rules != FuzzyConfig().rules else ""
    return config.form.upper() + custom


UNITS = {
    "error": "rad",
    "error_rate": "rad/s",
    "output": "",
    "table_term": "N m",
    "integral": "N m",
    "unsaturated": "N m",
    "effort": "N m",
}
LOOKUP = Lookup(error_inputs, cell, near, TorqueCell)
LAW = Law(
    "fuzzy",
    "Fuzzy",
    FuzzyConfig,
    fuzzy_update,
    PidState(),
    FuzzyTerms,
    UNITS,
    transfer,
    reconfigure,
    describe,
    LOOKUP,
)
