"""State feedback: lqr's update, and a gain of either sign on the other coordinate and on its rate."""

from dataclasses import replace
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.controller import Controller
from trunk_control.law import DERIVATIVE_FROM_RATE, Hip, Limits, Sample
from trunk_control.lqr import LqrConfig, lqr_update
from trunk_control.pid_family import Gains, PidState
from trunk_control.state_feedback import StateFeedbackConfig, reconfigure, state_feedback_update

SMALL = st.floats(-5.0, 5.0)
FROM_RATE = Limits(derivative=DERIVATIVE_FROM_RATE)
STARTED = PidState(0.02, 0.1, 0.2, -0.3, 4.0, True)


@given(SMALL, SMALL, SMALL, SMALL, SMALL)
def test_without_gains_on_the_hip_it_is_lqr_without_a_model(reference, angle, rate, position, v):
    gains = StateFeedbackConfig().gains
    assert gains == LqrConfig().gains
    sample = Sample(reference, angle, rate, 0.005, Hip(position, v))
    expected = lqr_update(STARTED, sample, (gains, 0.0), FROM_RATE)
    assert state_feedback_update(STARTED, sample, (gains, 0.0, 0.0), FROM_RATE) == expected


@given(st.lists(st.floats(-300.0, 300.0), min_size=4, max_size=4), SMALL, SMALL, SMALL, SMALL)
def test_it_is_minus_a_gain_times_each_state(gains, angle, rate, position, velocity):
    p, d, x, v = gains
    sample = Sample(0.0, angle, rate, 0.005, Hip(position, velocity))
    constants = Gains(p, 0.0, d), x, v
    _, terms = state_feedback_update(PidState(), sample, constants, FROM_RATE)
    expected = -(p * angle + d * rate + x * position + v * velocity)
    assert terms.unsaturated == pytest.approx(expected, abs=1e-9)


def test_the_hips_part_is_inside_the_limits():
    limits, constants = Limits(u_min=-3.0, u_max=3.0), (Gains(0.0, 0.0, 0.0), -20.0, 1.0)
    sample = Sample(0.0, 0.0, 0.0, 0.01, Hip(0.5, 1.0))
    _, terms = state_feedback_update(PidState(), sample, constants, limits)
    assert (terms.unsaturated, terms.effort) == (9.0, 3.0)


@pytest.mark.parametrize("bad", [Hip(nan, 0.0), Hip(0.0, inf), Hip(1e308, -1e308)], ids=str)
@pytest.mark.parametrize("x", [0.0, 1e9])
def test_a_bad_hip_holds_the_command(bad, x):
    if x == 0.0 and bad.position == 1e308:
        return  # finite, and without a gain of no effect
    sample, constants = Sample(0.0, 0.1, 0.0, 0.01, bad), (Gains(1.0, 1.0, 1.0), x, x)
    limits = FROM_RATE._replace(
        u_min=-9.0, u_max=9.0
    )  # an infinite command is not limited, but held
    held, terms = state_feedback_update(STARTED, sample, constants, limits)
    assert held is STARTED
    assert (terms.effort, terms.held) == (4.0, True)


@pytest.mark.parametrize("changes", [{"x": -30.0}, {"v": 12.0, "p": -40.0}, {"i": 9.0, "x": 4.0}])
def test_new_gains_do_not_move_the_command(changes):
    config = StateFeedbackConfig(x=3.0, v=-2.0, u_clamp_max=inf, u_clamp_min=-inf)
    sample = Sample(0.1, 0.3, -0.5, 1e-9, Hip(0.7, -1.1))
    after = replace(config, **changes)
    state, terms = state_feedback_update(STARTED, sample, config.constants, config.limits)
    state = reconfigure(state, sample, config.constants, after.constants)
    _, again = state_feedback_update(state, sample, after.constants, config.limits)
    assert again.unsaturated == pytest.approx(terms.unsaturated, abs=1e-6)


def test_new_gains_leave_a_finite_integral():
    sample, config = Sample(0.0, 0.0, 0.0, 0.01, Hip(1e308, 0.0)), StateFeedbackConfig()
    after = replace(config, x=1e9)
    assert reconfigure(STARTED, sample, config.constants, after.constants) is STARTED
    fresh = PidState()
    assert reconfigure(fresh, Sample(*[0.0] * 4), config.constants, after.constants) is fresh
    kept = reconfigure(STARTED, sample, config.constants, replace(config, i=0.0).constants)
    assert kept is STARTED


def test_it_needs_the_joint_of_the_other_coordinate():
    config = StateFeedbackConfig(hip_joint="cart")
    assert (config.hip, config.uses_rate) == ("cart", True)
    answer = Controller(config).update(0, 0.0, 0.0, 0.0, Hip(1.0, 1.0))
    assert answer.effort == 0.0
    pushed = Controller(replace(config, x=-2.0)).update(0, 0.0, 0.0, 0.0, Hip(1.0, 1.0))
    assert pushed.effort == 2.0
