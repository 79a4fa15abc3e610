"""For any input in any order, a command is finite and within its limits."""

from math import inf, isfinite
from sys import float_info

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.computed_torque import ComputedTorqueConfig, computed_torque_update
from trunk_control.controller import Controller
from trunk_control.fuzzy_pid import FuzzyPidConfig, GainBox, fuzzy_pid_update
from trunk_control.law import ANTIWINDUP_BACK_CALCULATION, Hip, Limits, Sample
from trunk_control.lqr import LqrConfig, lqr_update
from trunk_control.pid import PidConfig, pid_update
from trunk_control.pid_family import Gains, PidState, rescaled
from trunk_control.state_feedback import reconfigure, state_feedback_update
from trunk_core.mechanics import Body

TINY, HUGE = 5e-324, float_info.max
anything = st.floats()  # infinities, NaN and subnormal numbers too
number = st.floats(allow_nan=False, allow_infinity=False)
not_negative = st.floats(0.0, HUGE) | st.sampled_from([0.0, TINY, 1e-200, 1e200, HUGE])
positive = not_negative.map(lambda value: value or TINY)
dts = st.sampled_from([0.0, TINY, 1e-9, 0.005, 4e9, HUGE])
gains = st.builds(Gains, not_negative, not_negative, not_negative)
signed = st.tuples(st.builds(Gains, number, not_negative, number), number, number)


@st.composite
def laws(draw) -> Limits:
    low, high = sorted(draw(st.lists(anything.filter(lambda v: v == v), min_size=2, max_size=2)))
    if low == inf or high == -inf:
        low, high = -inf, inf
    i_min, i_max = -draw(not_negative | st.just(inf)), draw(not_negative | st.just(inf))
    mode, filter_time = draw(st.integers(0, 2)), draw(not_negative)
    strategy, tracking = draw(st.integers(0, 2)), draw(not_negative)
    return Limits(mode, filter_time, low, high, i_min, i_max, strategy, tracking)


states = st.builds(PidState, number, number, number, number, number, st.booleans())
samples = st.tuples(anything, anything, anything, dts)


RULES = [
    FuzzyPidConfig(error_range=e, rate_range=rate, alpha_centers=alpha, consequents=kind).rules
    for e, rate, alpha, kind in (
        (1.0, 5.0, (2.0, 3.0, 4.0, 5.0), "linear"),
        (TINY, TINY, (TINY,) * 4, "linear"),  # peaks that fall together
        (1e3, 1e5, (TINY, 1.0, 1e6, 1e6), "log"),
    )
]
boxes = st.builds(
    lambda p, d: GainBox(*sorted(p), *sorted(d)),
    st.tuples(positive, positive),
    st.tuples(positive, positive),
)
harmonics = st.none() | st.lists(st.tuples(number, number), min_size=1, max_size=3).map(
    lambda pairs: tuple(number for pair in pairs for number in pair)
)
models = st.builds(
    Body,
    *(positive, positive, positive, not_negative, number, number),
    harmonics=harmonics,
)


def pid_step(data):
    chosen = data.draw(gains)
    return lambda state, sample, law: pid_update(state, *sample, chosen, law)


def fuzzy_pid_step(data):
    chosen = data.draw(st.sampled_from(RULES)), data.draw(boxes)
    return lambda state, sample, law: fuzzy_pid_update(state, Sample(*sample), chosen, law)


def lqr_step(data):
    chosen = data.draw(gains), data.draw(not_negative)
    return lambda state, sample, law: lqr_update(state, Sample(*sample), chosen, law)


def computed_torque_step(data):
    hip = Hip(data.draw(anything), data.draw(anything))
    chosen = data.draw(gains), data.draw(models), data.draw(st.booleans())
    return lambda state, sample, law: computed_torque_update(
        state, Sample(*sample, hip), chosen, law
    )


def state_feedback_step(data):
    hip, chosen = Hip(data.draw(anything), data.draw(anything)), data.draw(signed)
    return lambda state, sample, law: state_feedback_update(
        state, Sample(*sample, hip), chosen, law
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "make_step",
    [pid_step, fuzzy_pid_step, lqr_step, computed_torque_step, state_feedback_step],
)
@given(st.data())
def test_every_command_is_finite_and_within_its_limits(make_step, data):
    law, state = data.draw(laws()), data.draw(states)
    for _ in range(3):
        before = state
        state, terms = make_step(data)(state, data.draw(samples), law)
        assert isfinite(terms.effort)
        assert law.u_min <= terms.effort <= law.u_max
        assert all(map(isfinite, state))
        assert terms.held == (state is before)


@given(states, gains, gains)
def test_retuning_leaves_a_finite_integral(state, old, new):
    after = rescaled(state, old, new)
    assert all(map(isfinite, after))
    assert after._replace(integral=state.integral) == state


@given(states, st.builds(Hip, number, number), signed, signed)
def test_new_feedback_of_the_hip_leaves_a_finite_integral(state, hip, old, new):
    after = reconfigure(state, Sample(0.0, 0.0, 0.0, 0.0, hip), old, new)
    assert all(map(isfinite, after))
    assert after._replace(integral=state.integral) == state


def test_an_overflow_holds_the_last_command_within_the_current_limits():
    state = PidState(1.0, 1.0, 1.0, 0.0, effort=70.0, started=True)
    after, terms = pid_update(state, 1e300, 0.0, -1e300, 0.01, Gains(1e9, 0.0, 1e9), Limits(2))
    assert after.effort == terms.effort == 70.0  # inf + inf without a limit is no command
    law = Limits(2, u_min=-50.0, u_max=50.0)
    after, terms = pid_update(state, 1e300, 0.0, -1e300, 0.01, Gains(1e9, 0.0, 1e9), law)
    assert terms.effort == 50.0 == after.effort  # with a limit its sign is enough
    assert not terms.held
    after, terms = pid_update(state, 1e300, 0.0, 1e300, 0.01, Gains(1e9, 0.0, 1e9), law)
    assert after is state  # inf - inf
    assert terms.effort == 50.0


def test_back_calculation_with_an_integral_gain_that_underflows_in_a_product():
    law = Limits(u_min=-1.0, u_max=1.0, antiwindup=ANTIWINDUP_BACK_CALCULATION)
    law = law._replace(tracking_time_constant=1e-3)
    state, terms = pid_update(PidState(), 5.0, 0.0, 0.0, 1e-3, Gains(1.0, TINY, 0.0), law)
    assert (state.integral, terms.effort) == (0.005, 1.0)


@pytest.mark.parametrize(
    ("controller", "config"),
    [
        (Controller, PidConfig),
        (Controller, FuzzyPidConfig),
        (Controller, LqrConfig),
        (Controller, ComputedTorqueConfig),
    ],
)
def test_a_held_command_obeys_new_limits_at_once(controller, config):
    driven = controller(config())
    assert driven.update(0, -3.0, 0.0).effort == 100.0
    driven.reconfigure(config(u_clamp_max=5.0))
    assert driven.update(1, -3.0, 0.0).effort == 5.0  # no update is due
    never = controller(config(u_clamp_min=2.0))
    answer = never.update(0, inf, 0.0)
    assert (answer.effort, answer.held, answer.updated) == (2.0, True, False)
    never.reset()
    assert never.memory.effort == 2.0
