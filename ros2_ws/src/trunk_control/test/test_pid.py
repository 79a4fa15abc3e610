"""One PID update at a time, against hand calculations."""

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.law import (
    ANTIWINDUP_BACK_CALCULATION,
    ANTIWINDUP_CONDITIONAL_INTEGRATION,
    ANTIWINDUP_NONE,
    DERIVATIVE_FROM_RATE,
    DERIVATIVE_ON_ERROR,
    DERIVATIVE_ON_MEASUREMENT,
    Limits,
)
from trunk_control.pid import PidConfig, pid_update
from trunk_control.pid_family import Gains, PidState, alpha_of, combine

GAINS = Gains(2.0, 4.0, 0.5)
DT = 0.25
# (reference, measurement, rate) and the derivative that each mode gives.
SAMPLES = [(1.0, 0.5, 3.0), (2.0, 0.75, -1.0), (2.0, 0.25, 0.5)]
DERIVATIVES = {
    DERIVATIVE_ON_ERROR: [0.0, 3.0, 2.0],
    DERIVATIVE_ON_MEASUREMENT: [0.0, -1.0, 2.0],
    DERIVATIVE_FROM_RATE: [-3.0, 1.0, -0.5],
}
modes = pytest.mark.parametrize("mode", DERIVATIVES, ids=["error", "measurement", "rate"])


FREE = Limits()
RESET = PidState()


def run(samples, law=FREE, gains=GAINS, state=RESET):
    history = []
    for reference, measurement, rate in samples:
        state, terms = pid_update(state, reference, measurement, rate, DT, gains, law)
        history.append(terms)
    return state, history


@modes
def test_terms_of_three_samples(mode):
    _, history = run(SAMPLES, Limits(derivative=mode))
    errors, integrals = [0.5, 1.25, 1.75], [0.125, 0.4375, 0.875]
    for terms, e, i, d in zip(history, errors, integrals, DERIVATIVES[mode], strict=True):
        assert (terms.error, terms.error_rate) == (e, d)
        assert (terms.p_term, terms.i_term, terms.d_term) == (2.0 * e, 4.0 * i, 0.5 * d)
        assert terms.effort == terms.unsaturated == 2.0 * e + 4.0 * i + 0.5 * d
        assert (terms.kp, terms.ki, terms.kd) == GAINS


def test_a_feed_forward_is_added_within_the_limits():
    arguments = (PidState(0.25), 0.5, 0.0, 2.0, DT, GAINS, 1.0)
    _, terms = combine(*arguments, FREE, 7.0)
    assert terms.unsaturated == terms.effort == 2.0 * 0.5 + 4.0 * 0.375 + 0.5 * 2.0 + 7.0
    assert combine(*arguments, Limits(u_max=8.0), 7.0)[1].effort == 8.0


@modes
def test_filter_is_its_recursion(mode):
    _, history = run(SAMPLES, Limits(derivative=mode, filter_time=0.75))
    filtered, expected = 0.0, []
    for derivative in DERIVATIVES[mode]:
        filtered += 0.25 / (0.75 + 0.25) * (derivative - filtered)
        expected.append(filtered)
    assert [terms.error_rate for terms in history] == expected
    assert [terms.d_term for terms in history] == [0.5 * f for f in expected]


def test_only_the_derivative_on_error_kicks_at_a_reference_step():
    step = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    kicks = [run(step, Limits(derivative=mode))[1][1].d_term for mode in DERIVATIVES]
    assert kicks == [0.5 * 1.0 / DT, 0.0, 0.0]


@pytest.mark.parametrize(
    ("measurement", "effort"),
    [(-5.0, 3.0), (5.0, -2.0), (0.75, -2.0), (-0.5, 1.5)],
    ids=["max", "min", "just-below-min", "between"],
)
def test_command_is_limited(measurement, effort):
    law = Limits(u_min=-2.0, u_max=3.0)
    state, (terms,) = run([(0.0, measurement, 0.0)], law)
    assert terms.effort == state.effort == effort
    assert terms.unsaturated == -3.0 * measurement


@pytest.mark.parametrize(
    ("error", "first", "term"), [(1.0, 1.0, 1.5), (-1.0, -0.5, -0.5)], ids=["max", "min"]
)
def test_integral_term_is_limited(error, first, term):
    law = Limits(i_min=-0.5, i_max=1.5)
    state, history = run([(error, 0.0, 0.0)] * 5, law)
    assert [terms.i_term for terms in history] == [first, term, term, term, term]
    assert state.integral == term / GAINS.i
    _, (back,) = run([(-error, 0.0, 0.0)], law, state=state)  # the integral did not wind up
    assert back.i_term == term - GAINS.i * DT * error


def test_integral_limit_of_zero_without_integral_gain():
    state, history = run([(1.0, 0.0, 0.0)], Limits(i_min=0.0, i_max=0.0), Gains(1.0, 0.0, 0.0))
    assert (history[0].i_term, state.integral) == (0.0, DT)


@pytest.mark.parametrize(("i_min", "i_max", "term"), [(-2.0, -1.0, -1.0), (1.0, 2.0, 1.0)])
def test_limits_beyond_zero_leave_the_integral_alone_without_integral_gain(i_min, i_max, term):
    law = Limits(i_min=i_min, i_max=i_max)
    state, (terms,) = run([(1.0, 0.0, 0.0)], law, Gains(1.0, 0.0, 0.0))
    assert (terms.i_term, state.integral) == (term, DT)


def test_without_a_filter_the_derivative_forgets_the_one_before():
    state = PidState(derivative=1e16, started=True)  # 1e16 + (2 - 1e16) would have lost the 2
    _, terms = pid_update(state, 0.75, 0.0, 0.0, DT, GAINS, Limits())
    assert terms.error_rate == 3.0


def test_zero_dt_holds_the_last_command():
    law = Limits(u_max=3.0)
    before, history = run(SAMPLES[:2], law)
    after, terms = pid_update(before, 9.0, -9.0, 9.0, 0.0, GAINS, law)
    assert after == before
    assert terms.effort == terms.unsaturated == history[-1].effort == 3.0
    assert (terms.held, history[-1].held) == (True, False)
    # No term of its own stands behind it; error and derivative are those of the last sample.
    assert (terms.p_term, terms.i_term, terms.d_term) == (0.0, 0.0, 0.0)
    assert (terms.error, terms.error_rate) == (1.25, 3.0)
    assert (terms.kp, terms.ki, terms.kd, terms.alpha) == (*GAINS, alpha_of(GAINS))


def test_negative_dt_holds():
    before, _ = run(SAMPLES[:2], Limits())
    after, terms = pid_update(before, 1.0, 0.0, 0.0, -1e-9, GAINS, Limits())
    assert after == before
    assert terms.held
    assert terms.effort == before.effort


@pytest.mark.parametrize("bad", [nan, inf, -inf], ids=str)
@pytest.mark.parametrize("place", range(3), ids=["reference", "measurement", "rate"])
@modes
def test_a_non_finite_sample_changes_nothing(mode, place, bad):
    law = Limits(derivative=mode, filter_time=0.5)
    before, history = run(SAMPLES[:2], law)
    sample = list(SAMPLES[2])
    sample[place] = bad
    after, terms = pid_update(before, *sample, DT, GAINS, law)
    assert after == before
    assert terms.effort == history[-1].effort


def test_the_words_of_the_parameters_choose_the_laws():
    derivative = {
        "error": DERIVATIVE_ON_ERROR,
        "measurement": DERIVATIVE_ON_MEASUREMENT,
        "rate": DERIVATIVE_FROM_RATE,
    }
    for word, code in derivative.items():
        assert PidConfig(derivative_mode=word).limits.derivative == code
    antiwindup = {
        "none": ANTIWINDUP_NONE,
        "conditional_integration": ANTIWINDUP_CONDITIONAL_INTEGRATION,
        "back_calculation": ANTIWINDUP_BACK_CALCULATION,
    }
    for word, code in antiwindup.items():
        assert PidConfig(antiwindup_strategy=word).limits.antiwindup == code


def test_default_state_is_the_state_after_a_reset():
    used, first = run(SAMPLES)
    assert used != PidState()
    assert run(SAMPLES, state=PidState())[1] == first


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), max_size=20), st.sampled_from([0, 1, 2]))
def test_command_never_leaves_its_limits(samples, antiwindup):
    law = Limits(filter_time=0.01, u_min=-7.0, u_max=11.0, antiwindup=antiwindup)
    assert all(-7.0 <= terms.effort <= 11.0 for terms in run(samples, law)[1])


@pytest.mark.parametrize(
    ("gains", "alpha"),
    [
        (Gains(60.0, 100.0, 9.0), 4.0),
        (Gains(0.5, 0.25, 0.5), 2.0),
        (Gains(60.0, 0.0, 9.0), 0.0),
        (Gains(60.0, 1.0, 0.0), 0.0),
    ],
)
def test_alpha(gains, alpha):
    assert alpha_of(gains) == alpha
    assert run(SAMPLES, gains=gains)[1][0].alpha == alpha
