"""What the integral does while the command is limited."""

from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.law import (
    ANTIWINDUP_BACK_CALCULATION,
    ANTIWINDUP_CONDITIONAL_INTEGRATION,
    ANTIWINDUP_NONE,
    Limits,
)
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState

DT = 0.01
GAINS = Gains(1.0, 10.0, 0.0)
IDS = ["none", "conditional_integration", "back_calculation"]


def limited(antiwindup: int, **others) -> Limits:
    return Limits(u_min=-2.0, u_max=2.0, antiwindup=antiwindup, **others)


def update(state: PidState, error: float, law: Limits, gains: Gains = GAINS):
    return pid_update(state, error, 0.0, 0.0, DT, gains, law)


def samples_to_leave_the_limit(antiwindup: int, push: float) -> int:
    """Saturate for 5 s, reverse the error, count the samples until the command follows."""
    law, state = limited(antiwindup), PidState()
    for _ in range(500):
        state, _ = update(state, push, law)
    for count in range(10_000):
        state, terms = update(state, -0.1 * push, law)
        if abs(terms.unsaturated) < 2.0:
            return count
    raise AssertionError("the command never left its limit")


@pytest.mark.parametrize("push", [1.0, -1.0], ids=["up", "down"])
def test_the_integral_winds_up_only_without_a_strategy(push):
    none, conditional, back = (samples_to_leave_the_limit(a, push) for a in range(3))
    assert none > 1000
    assert conditional == 0
    assert back == 0


@pytest.mark.parametrize("antiwindup", range(3), ids=IDS)
def test_no_strategy_acts_on_a_free_command(antiwindup):
    state, free = PidState(), PidState()
    for error in (0.1, 0.2, -0.1, 0.05):
        state, _ = update(state, error, limited(antiwindup))
        free, _ = update(free, error, Limits())
    assert state == free


def test_conditional_integration_drops_the_increment_afterwards():
    state = PidState(integral=0.15)
    after, terms = update(state, 1.0, limited(ANTIWINDUP_CONDITIONAL_INTEGRATION))
    assert terms.i_term == 10.0 * (0.15 + DT)  # used in this sample
    assert after.integral == 0.15


def test_conditional_integration_drops_the_smallest_increment_too():
    law = limited(ANTIWINDUP_CONDITIONAL_INTEGRATION)
    after, terms = update(PidState(integral=0.25), 1e-3, law)
    assert terms.effort == 2.0
    assert after.integral == 0.25


@pytest.mark.parametrize("error", [-1.0, -1e-3])
def test_conditional_integration_keeps_an_increment_that_unwinds(error):
    state = PidState(integral=0.9)
    after, terms = update(state, error, limited(ANTIWINDUP_CONDITIONAL_INTEGRATION))
    assert terms.unsaturated > 2.0
    assert after.integral == 0.9 + DT * error


@pytest.mark.parametrize(
    ("gains", "time_constant", "tracking"),
    [
        (GAINS, 0.5, 0.5),
        (Gains(1.0, 10.0, 0.4), 0.0, sqrt(0.4 / 10.0)),  # sqrt(Ti Td)
        (GAINS, 0.0, 1.0 / 10.0),  # no D: Ti
        (GAINS, 1e-6, DT),  # never faster than the sampling
        (Gains(0.0, 10.0, 0.0), 0.0, DT),
        (Gains(1.0, 10.0, 2.5), 0.0, 0.5),  # sqrt(Ti Td), D above 1
        (Gains(1.0, 10.0, 0.4), 0.125, 0.125),  # a given one counts before those of the gains
        (Gains(1.0, 1.5, 0.0), 0.25, 0.25),  # their product is below 1
        (Gains(1.0, 1.5, 0.0), 2.0, 2.0),
        (Gains(2.5, 0.5, 0.0), 0.0, 5.0),  # so is ki
    ],
    ids=[
        "given",
        "PID",
        "PI",
        "too-fast",
        "I",
        "PID, great D",
        "given, PID",
        "small product",
        "slow",
        "PI, small I",
    ],
)
def test_back_calculation_tracks_with_its_time_constant(gains, time_constant, tracking):
    law = limited(ANTIWINDUP_BACK_CALCULATION, tracking_time_constant=time_constant)
    after, terms = update(PidState(integral=4.0), 1.0, law, gains)
    excess = terms.unsaturated - 2.0
    assert excess > 0.0
    expected = 4.0 + DT - DT * excess / (tracking * gains.i)
    assert after.integral == pytest.approx(expected, rel=1e-14)


@given(st.floats(0.0, 50.0), st.floats(0.1, 50.0), st.floats(0.0, 5.0), st.floats(0.0, 10.0))
def test_back_calculation_never_diverges(kp, ki, kd, tracking):
    law = limited(ANTIWINDUP_BACK_CALCULATION, tracking_time_constant=tracking)
    state = PidState(integral=5.0)
    for _ in range(300):
        state, _ = update(state, 1.0, law, Gains(kp, ki, kd))
    resting = (2.0 + kp + 1.0 + ki * max(tracking, kp / ki, sqrt(kd / ki), DT)) / ki
    assert abs(state.integral) <= 5.0 + resting


@pytest.mark.parametrize("kd", [0.0, 1.0])
def test_back_calculation_without_integral_gain_leaves_the_integral(kd):
    law = limited(ANTIWINDUP_BACK_CALCULATION)
    state, terms = update(PidState(), 50.0, law, Gains(1.0, 0.0, kd))
    assert (terms.effort, state.integral) == (2.0, 0.5)


def test_without_a_strategy_the_integral_keeps_growing():
    state, _ = update(PidState(integral=5.0), 1.0, limited(ANTIWINDUP_NONE))
    assert state.integral == 5.0 + DT
