"""The law whose table is the torque: its plane about the upright, its integral, takeovers, refusals."""

from dataclasses import replace
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.fuzzy_torque import (
    FuzzyConfig,
    fuzzy_update,
    reconfigure,
    transfer,
)
from trunk_control.law import (
    ANTIWINDUP_BACK_CALCULATION,
    ANTIWINDUP_CONDITIONAL_INTEGRATION,
    ANTIWINDUP_NONE,
    Limits,
    Sample,
)
from trunk_control.pid_family import PidState
from trunk_control.rule_tables import MACVICAR_WHELAN

PD, PI = FuzzyConfig(), FuzzyConfig(form="pi", output_scale=200.0)
H = 0.005
LIMITS = PD.limits
small = st.floats(-0.5, 0.5)


def test_the_default_table_is_odd_and_monotone():
    table = PD.rules.table
    assert MACVICAR_WHELAN[0] == "NB NB NB NB NM NS ZO"
    assert list(table) == [-value for value in reversed(table)]
    rows = [table[i * 7 : i * 7 + 7] for i in range(7)]
    assert all(list(line) == sorted(line) for line in (*rows, *zip(*rows, strict=True)))


@given(small, small)
def test_about_the_upright_it_is_a_pd_controller(error, rate):
    """In the middle cells the table is a plane: no limit of its labels is near."""
    e, r = error * PD.error_range / 3.0, rate * PD.rate_range / 3.0
    _, terms = fuzzy_update(PidState(), Sample(e, 0.0, -r, H), PD.constants, LIMITS)
    kp, kd = PD.output_scale / PD.error_range, PD.output_scale / PD.rate_range
    assert terms.unsaturated == pytest.approx(kp * e + kd * r, abs=1e-12)
    assert (terms.table_term, terms.integral) == (terms.unsaturated, 0.0)
    assert PD.damping_gain == pytest.approx(kd)


def test_the_form_pi_adds_up_what_the_table_gives():
    state, total = PidState(), 0.0
    for error in (0.2, -0.1, 0.4):
        state, terms = fuzzy_update(state, Sample(error, 0.0, 0.0, H), PI.constants, LIMITS)
        total += H * 200.0 * (error / PI.error_range)
        assert terms.unsaturated == terms.integral == pytest.approx(total)
        assert terms.table_term == 0.0
    assert PI.damping_gain == 0.0


@pytest.mark.parametrize(
    ("strategy", "time", "kept"),
    [
        (ANTIWINDUP_NONE, 0.0, 9.5 + 1.0),
        (ANTIWINDUP_CONDITIONAL_INTEGRATION, 0.0, 9.5),
        (ANTIWINDUP_BACK_CALCULATION, 0.0, 10.0),  # within one update
        (ANTIWINDUP_BACK_CALCULATION, 10 * H, 10.5 - 0.05),
    ],
)
def test_anti_windup_of_the_form_pi(strategy, time, kept):
    limits = Limits(
        LIMITS.derivative, 0.0, -10.0, 10.0, antiwindup=strategy, tracking_time_constant=time
    )
    state = PidState(9.5, 0.0, 0.0, 0.0, 9.5, True)
    sample = Sample(PI.error_range, 0.0, 0.0, H)  # the table gives 1: 1 N m an update
    after, terms = fuzzy_update(state, sample, PI.constants, limits)
    assert (terms.unsaturated, terms.effort) == (10.5, 10.0)
    assert after.integral == pytest.approx(kept, abs=1e-12)


def test_the_integral_stays_within_its_own_limits():
    limits = replace_limits(i_max=3.0)
    state = PidState(2.9, 0.0, 0.0, 0.0, 2.9, True)
    _, terms = fuzzy_update(state, Sample(PI.error_range, 0.0, 0.0, H), PI.constants, limits)
    assert terms.unsaturated == 3.0


def replace_limits(**values):
    return LIMITS._replace(**values)


def test_the_form_pi_takes_over_at_the_torque_that_acts():
    sample = Sample(0.3, 0.1, 0.2, H)
    memory = transfer(PidState(), 0.1, sample, -17.0, PI.constants, LIMITS)
    _, terms = fuzzy_update(memory, sample, PI.constants, LIMITS)
    assert terms.unsaturated == pytest.approx(-17.0)
    assert transfer(PidState(), 0.1, sample, -17.0, PD.constants, LIMITS).effort == -17.0


def test_new_parameters_move_the_form_pi_by_no_more_than_an_update():
    state = PidState(12.0, 0.1, 0.0, 0.0, 12.0, True)
    scaled = replace(PI, output_scale=900.0)
    sample = Sample(0.1, 0.0, 0.0, H)
    assert reconfigure(state, sample, PI.constants, scaled.constants) is state
    begun = reconfigure(state._replace(integral=0.0), sample, PD.constants, PI.constants)
    assert begun.integral == 12.0
    assert reconfigure(PidState(), sample, PD.constants, PI.constants) == PidState()


@pytest.mark.parametrize(("measurement", "dt"), [(nan, H), (inf, H), (0.1, 0.0), (0.1, -H)])
@pytest.mark.parametrize("config", [PD, PI], ids=["pd", "pi"])
def test_what_is_not_usable_is_held(config, measurement, dt):
    state = PidState(5.0, 0.1, 0.0, 0.2, 5.0, True)
    after, terms = fuzzy_update(state, Sample(0.0, measurement, 0.0, dt), config.constants, LIMITS)
    assert after == state
    assert (terms.held, terms.effort) == (True, 5.0)
