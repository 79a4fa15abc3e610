"""Gains from the rule base: their box, Ki from alpha, and the law that uses them."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trunk_control.fuzzy import infer
from trunk_control.fuzzy_pid import FuzzyPidConfig, GainBox, fuzzy_pid_update, inferred_gains
from trunk_control.law import Limits, Sample
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState

RULES = FuzzyPidConfig().rules
BOX = GainBox()
CONSTANTS = RULES, BOX


def tables(labels: str):
    row = st.lists(st.sampled_from(labels.split()), min_size=7, max_size=7).map(" ".join)
    return st.lists(row, min_size=7, max_size=7).map(tuple)


configurations = st.builds(
    FuzzyPidConfig,
    rules_kp=tables("S B"),
    rules_kd=tables("S B"),
    rules_alpha=tables("S MS M B"),
    consequents=st.sampled_from(["linear", "log"]),
)


@st.composite
def boxes(draw) -> GainBox:
    lows = [draw(st.floats(1e-3, 1e3)) for _ in range(2)]
    p_max, d_max = (low + draw(st.floats(0.0, 1e3)) for low in lows)
    return GainBox(lows[0], p_max, lows[1], d_max)


@pytest.mark.slow
@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), configurations, boxes())
@settings(max_examples=300)
def test_gains_never_leave_the_box(error, error_rate, config, box):
    gains, alpha = inferred_gains(error, error_rate, config.rules, box)
    assert box.p_min <= gains.p <= box.p_max
    assert box.d_min <= gains.d <= box.d_max
    assert 2.0 <= alpha <= 5.0
    assert gains.i == pytest.approx(gains.p**2 / (alpha * gains.d), rel=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("consequents", ["linear", "log"])
def test_printed_gains_never_leave_the_box(consequents):
    rules = FuzzyPidConfig(consequents=consequents).rules
    box = GainBox(0.3, 0.9, 0.6, 1.7)  # 0.3 + (0.9 - 0.3) > 0.9, 0.6 + (1.7 - 0.6) > 1.7
    inputs = np.random.default_rng(1).uniform((-1.7, -5.5), (1.7, 5.5), (20_000, 2)).tolist()
    for error, rate in inputs:
        gains, alpha = inferred_gains(error, rate, rules, box)
        assert box.p_min <= gains.p <= box.p_max
        assert box.d_min <= gains.d <= box.d_max
        assert 2.0 <= alpha <= 5.0


@pytest.mark.parametrize(
    ("error", "rate", "gains"),
    [
        (0.0, 0.0, Gains(60.0, 60.0**2 / (3.0 * 18.0), 18.0)),  # ZO, ZO: B, B, MS
        (10.0, 0.0, Gains(60.0, 60.0**2 / (2.0 * 9.6), 9.6)),  # PB, ZO: B, S, S
        (0.0, 99.0, Gains(32.0, 32.0**2 / (5.0 * 18.0), 18.0)),  # ZO, PB: S, B, B
    ],
    ids=["ZO-ZO", "PB-ZO", "ZO-PB"],
)
def test_gains_at_three_rules(error, rate, gains):
    assert inferred_gains(error, rate, RULES, BOX)[0] == pytest.approx(gains, rel=1e-15)


def test_the_integral_gain_where_alpha_kd_is_one_and_where_it_vanishes():
    at_two = (10.0, 0.0)  # PB, ZO: alpha = 2, Kd small
    gains, _ = inferred_gains(*at_two, RULES, GainBox(3.0, 3.0, 0.5, 0.5))
    assert gains == Gains(3.0, 9.0, 0.5)
    flat = RULES._replace(alpha=(0.25,) * 49)
    gains, _ = inferred_gains(*at_two, flat, GainBox(3.0, 3.0, 5e-324, 5e-324))
    assert gains.i == inf


def test_gains_scale_with_the_inferred_values():
    kp, kd, _ = infer(0.37, -0.81, RULES)
    gains, _ = inferred_gains(0.37, -0.81, RULES, BOX)
    assert gains.p == pytest.approx(32.0 + 28.0 * kp, rel=1e-15)
    assert gains.d == pytest.approx(9.6 + 8.4 * kd, rel=1e-15)


def test_default_box_is_equation_16_corrected():
    ku, tu = 100.0, 1.2
    expected = (0.32 * ku, 0.60 * ku, 0.08 * ku * tu, 0.15 * ku * tu)
    assert pytest.approx(expected, rel=1e-15) == BOX


@pytest.mark.parametrize("derivative", range(3), ids=["error", "measurement", "rate"])
def test_update_is_the_pid_with_the_gains_of_the_same_sample(derivative):
    law = Limits(derivative, filter_time=0.02, u_min=-40.0, u_max=40.0, antiwindup=1)
    fuzzy = PidState()
    for reference, measurement, rate in [(0.0, 0.5, 0.3), (0.8, 0.4, -2.0), (0.8, 0.9, 4.0)]:
        before = fuzzy
        fuzzy, terms = fuzzy_pid_update(
            before, Sample(reference, measurement, rate, 0.01), CONSTANTS, law
        )
        gains, alpha = inferred_gains(terms.error, terms.error_rate, RULES, BOX)
        expected = pid_update(before, reference, measurement, rate, 0.01, gains, law)
        assert fuzzy == expected[0]
        assert terms == expected[1]._replace(alpha=alpha)


def test_the_integral_does_not_depend_on_the_gains():
    # Ki stands outside the sum: the integral is that of the error, whatever the gains.
    state, total = PidState(), 0.0
    for error in (0.1, 1.5, -0.7):
        state, terms = fuzzy_pid_update(state, Sample(error, 0.0, 0.0, 0.01), CONSTANTS, Limits())
        total += 0.01 * error
        assert state.integral == total
        assert terms.i_term == terms.ki * total


@pytest.mark.parametrize(
    ("measurement", "dt"), [(0.2, 0.0), (nan, 0.01)], ids=["zero-dt", "not-finite"]
)
def test_update_holds(measurement, dt):
    law = Limits()
    before, first = fuzzy_pid_update(PidState(), Sample(0.0, 0.5, 1.0, 0.01), CONSTANTS, law)
    after, held = fuzzy_pid_update(before, Sample(0.0, measurement, 1.0, dt), CONSTANTS, law)
    assert after == before
    assert (held.effort, held.kp, held.ki, held.kd, held.alpha) == (
        first.effort,
        first.kp,
        first.ki,
        first.kd,
        first.alpha,
    )


def test_negative_dt_holds():
    before = PidState(0.1, 0.2, -0.2, 0.3, 4.0, True)
    after, terms = fuzzy_pid_update(before, Sample(0.0, 0.5, 1.0, -0.01), CONSTANTS, Limits())
    assert after == before
    assert (terms.held, terms.effort) == (True, 4.0)
