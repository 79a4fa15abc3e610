"""Four rules equal all forty-nine; the partition, its ends, logarithmic consequents."""

from itertools import accumulate, pairwise
from math import exp, inf, nextafter, pi
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trunk_control.fuzzy import (
    FuzzyRules,
    cell_at,
    fired_rules,
    infer,
    locate,
    logarithmic_value,
    rules_of,
)
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.fuzzy_torque import TorqueRules, table_output

PRINTED = FuzzyPidConfig().rules


def memberships(value: float, peaks) -> np.ndarray:
    """The triangles at a value, each by its own formula, clamped to the universe."""
    value = min(max(value, peaks[0]), peaks[-1])
    result = np.zeros(len(peaks))
    for i, peak in enumerate(peaks):
        if value == peak:
            result[i] = 1.0
        elif i > 0 and peaks[i - 1] < value < peak:
            result[i] = (value - peaks[i - 1]) / (peak - peaks[i - 1])
        elif i + 1 < len(peaks) and peak < value < peaks[i + 1]:
            result[i] = (peaks[i + 1] - value) / (peaks[i + 1] - peak)
    return result


def all_rules(error: float, error_rate: float, rules: FuzzyRules) -> tuple[float, float, float]:
    """Product inference and centre average over every rule, as the paper defines them."""
    firing = np.outer(
        memberships(error, rules.error_peaks), memberships(error_rate, rules.rate_peaks)
    )

    def average(table, logarithmic):
        centers = np.reshape(table, firing.shape)
        if logarithmic:
            small, big = np.exp(-4.0 * firing), 1.0 - np.exp(-4.0 * firing)
            centers = (1.0 - centers) * small + centers * big
        return (firing * centers).sum() / firing.sum()

    return (
        average(rules.kp, rules.logarithmic),
        average(rules.kd, rules.logarithmic),
        average(rules.alpha, False),
    )


both = pytest.mark.parametrize("logarithmic", [False, True], ids=["linear", "log"])


@pytest.mark.slow
@both
def test_four_rules_equal_all_on_a_grid(logarithmic):
    rules = PRINTED._replace(logarithmic=logarithmic)
    grid = [
        (error, rate) for error in np.linspace(-1.8, 1.8, 91) for rate in np.linspace(-5.5, 5.5, 91)
    ]
    actual = np.array([infer(error, rate, rules) for error, rate in grid])
    expected = np.array([all_rules(error, rate, rules) for error, rate in grid])
    assert np.abs(actual - expected).max() <= 1e-14


@st.composite
def peaks(draw, count: int = 7) -> tuple[float, ...]:
    gaps = draw(st.lists(st.floats(1e-3, 2.0), min_size=count - 1, max_size=count - 1))
    return tuple(accumulate(gaps, initial=draw(st.floats(-5.0, 0.0))))


sizes = st.sampled_from([2, 3, 5, 7]) | st.integers(2, 64)


@st.composite
def rule_bases(draw) -> FuzzyRules:
    """Rule bases of any size, from 2 x 2 to 64 x 64."""
    rows, columns = draw(sizes), draw(sizes)
    random = Random(draw(st.integers(0, 2**32)))

    def table(*centers: float) -> tuple[float, ...]:
        return tuple(random.choice(centers) for _ in range(rows * columns))

    return FuzzyRules(
        draw(peaks(rows)),
        draw(peaks(columns)),
        table(0.0, 1.0, 0.3),
        table(0.0, 1.0),
        table(2.0, 3.0, 4.0, 5.0),
        draw(st.booleans()),
    )


values = st.floats(-10.0, 10.0)


@pytest.mark.slow
@given(values, values, rule_bases())
@settings(max_examples=300)
def test_four_rules_equal_all_for_any_tables_and_peaks(error, error_rate, rules):
    inferred = infer(error, error_rate, rules)
    assert inferred == pytest.approx(all_rules(error, error_rate, rules), rel=0.0, abs=1e-14)
    torque = TorqueRules(rules.error_peaks, rules.rate_peaks, rules.alpha)
    assert table_output(error, error_rate, torque) == inferred[2]


@given(values, values, rule_bases())
def test_outputs_never_leave_their_centres(error, error_rate, rules):
    kp, kd, alpha = infer(error, error_rate, rules)
    assert 0.0 <= kp <= 1.0
    assert 0.0 <= kd <= 1.0
    assert 2.0 <= alpha <= 5.0


def test_rounding_never_carries_printed_outputs_past_their_centres():
    inputs = np.random.default_rng(1).uniform((-1.6, -5.1), (1.6, 5.1), (20_000, 2))
    outputs = np.array([infer(error, rate, PRINTED) for error, rate in inputs.tolist()])
    assert (outputs >= (0.0, 0.0, 2.0)).all()
    assert (outputs <= (1.0, 1.0, 5.0)).all()


@pytest.mark.parametrize("row", range(7))
def test_at_a_pair_of_peaks_one_rule_fires(row):
    for column in range(7):
        cell = 7 * row + column
        expected = (PRINTED.kp[cell], PRINTED.kd[cell], PRINTED.alpha[cell])
        assert infer(PRINTED.error_peaks[row], PRINTED.rate_peaks[column], PRINTED) == expected


@given(values, peaks())
def test_memberships_sum_to_one(value, peaks):
    i, weight = locate(value, peaks)
    assert 0 <= i < len(peaks) - 1
    assert 0.0 <= weight <= 1.0
    expected = memberships(value, peaks)
    assert expected.sum() == pytest.approx(1.0, abs=1e-15)
    assert expected[i] == pytest.approx(1.0 - weight, abs=1e-12)
    assert expected[i + 1] == pytest.approx(weight, abs=1e-12)


@both
@pytest.mark.parametrize("beyond", [pi / 2.0, 1.6, 1e9, inf], ids="{:g}".format)
def test_inputs_are_clamped_to_the_universe(beyond, logarithmic):
    rules = PRINTED._replace(logarithmic=logarithmic)
    for rate in (-1.0, 0.3, 2.0):
        assert infer(beyond, rate, rules) == infer(rules.error_peaks[-1], rate, rules)
        assert infer(-beyond, rate, rules) == infer(rules.error_peaks[0], rate, rules)
    for error in (-1.0, 0.3, 1.0):
        assert infer(error, 4.0 * beyond, rules) == infer(error, rules.rate_peaks[-1], rules)
        assert infer(error, -4.0 * beyond, rules) == infer(error, rules.rate_peaks[0], rules)


def test_logarithmic_memberships():
    assert logarithmic_value(0.25, 0.0) == exp(-1.0)
    assert logarithmic_value(0.25, 1.0) == 1.0 - exp(-1.0)
    assert (logarithmic_value(0.0, 0.0), logarithmic_value(0.0, 1.0)) == (1.0, 0.0)


def test_logarithmic_consequents_do_not_change_alpha():
    logarithmic = infer(0.3, -0.7, PRINTED._replace(logarithmic=True))
    linear = infer(0.3, -0.7, PRINTED)
    assert logarithmic[2] == linear[2]
    assert logarithmic[:2] != linear[:2]


@pytest.mark.slow
@given(values, values, rule_bases())
@settings(max_examples=300)
def test_fired_rules_add_up_to_the_inferred_values(error, error_rate, rules):
    fired = fired_rules(error, error_rate, rules)
    assert len({(rule.row, rule.column) for rule in fired}) == 4
    assert sum(rule.weight for rule in fired) == pytest.approx(1.0, abs=1e-15)
    firing = np.outer(
        memberships(error, rules.error_peaks), memberships(error_rate, rules.rate_peaks)
    )
    for rule in fired:
        assert rule.weight == pytest.approx(firing[rule.row, rule.column], abs=1e-12)
        assert rule.values[2] == rules.alpha[rule.row * len(rules.rate_peaks) + rule.column]
    sums = [sum(rule.weight * rule.values[n] for rule in fired) for n in range(3)]
    assert sums == pytest.approx(infer(error, error_rate, rules), rel=0.0, abs=1e-14)


@pytest.mark.parametrize("logarithmic", [False, True])
def test_a_cell_gives_what_all_rules_give(logarithmic):
    rules = PRINTED._replace(logarithmic=logarithmic)
    ends = [-inf, inf, 0.0, -0.0, 1e-300]
    errors = [*rules.error_peaks, *(nextafter(p, inf) for p in rules.error_peaks), *ends]
    rates = [*rules.rate_peaks, *(nextafter(p, -inf) for p in rules.rate_peaks), *ends]
    random = Random(4)
    places = [(e, r) for e in errors for r in rates]
    places += [(random.uniform(-2.0, 2.0), random.uniform(-6.0, 6.0)) for _ in range(2000)]
    cells = {cell_at(e, r, rules) for e, r in places}
    assert len(cells) == 36
    for e, r in places:
        (cell,) = [
            c for c in cells if c.error_from <= e < c.error_to and c.rate_from <= r < c.rate_to
        ] or [
            cell_at(e, r, rules)  # infinity is in none
        ]
        assert infer(e, r, rules_of(cell, rules)) == infer(e, r, rules)


def test_a_cell_holds_from_peak_to_peak_and_an_outer_one_without_end():
    """A cell that holds for less gives the same numbers, and is looked up too often."""
    rules = PRINTED
    held = [[-inf, *peaks[1:-1], inf] for peaks in (rules.error_peaks, rules.rate_peaks)]
    for i, (error, error_to) in enumerate(pairwise(rules.error_peaks)):
        for j, (rate, rate_to) in enumerate(pairwise(rules.rate_peaks)):
            cell = cell_at((error + error_to) / 2, (rate + rate_to) / 2, rules)
            assert cell[:4] == (held[0][i], held[0][i + 1], held[1][j], held[1][j + 1])
