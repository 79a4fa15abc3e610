"""The controllers' parameters: defaults and refusals."""

from __future__ import annotations

from math import inf, nan, pi

import pytest

from trunk_control.controller_config import ANTIWINDUP_STRATEGIES, DERIVATIVE_MODES
from trunk_control.fuzzy_pid import FuzzyPidConfig, GainBox
from trunk_control.limits import (
    ANTIWINDUP_BACK_CALCULATION,
    ANTIWINDUP_CONDITIONAL_INTEGRATION,
    ANTIWINDUP_NONE,
    DERIVATIVE_FROM_RATE,
    DERIVATIVE_ON_ERROR,
    DERIVATIVE_ON_MEASUREMENT,
    Limits,
)
from trunk_control.pid import PidConfig
from trunk_control.pid_family import Gains
from trunk_control.rule_tables import ALPHA_AS_PRINTED
from trunk_msgs_util.parameters.declarations import ParameterError, build, values_of

BOTH = [PidConfig, FuzzyPidConfig]


def test_default_gains_are_ziegler_nichols():
    ku, tu = 100.0, 1.2
    kp = 0.6 * ku
    expected = Gains(kp, kp / (tu / 2.0), kp * tu / 8.0)
    assert PidConfig().gains == pytest.approx(expected, rel=1e-15)


def test_default_rule_base():
    config = FuzzyPidConfig()
    rules = config.rules
    thirds = [-1.0, -2.0 / 3.0, -1.0 / 3.0, 0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]
    assert config.box == GainBox(32.0, 60.0, 9.6, 18.0)
    assert rules.error_peaks == pytest.approx([pi / 2.0 * part for part in thirds], rel=1e-15)
    assert rules.rate_peaks == pytest.approx([5.0 * part for part in thirds], rel=1e-15)
    centres = {"S": 2.0, "MS": 3.0, "M": 4.0, "B": 5.0}
    assert list(rules.alpha) == [centres[x] for row in ALPHA_AS_PRINTED for x in row.split()]
    assert not rules.logarithmic


@pytest.mark.parametrize("config", BOTH)
def test_default_law_is_the_practical_profile(config):
    law = Limits(
        DERIVATIVE_FROM_RATE, 0.0, -100.0, 100.0, -inf, inf, ANTIWINDUP_CONDITIONAL_INTEGRATION, 0.0
    )
    assert config().limits == law


def test_names_of_modes_and_strategies_are_in_the_laws_order():
    modes = (DERIVATIVE_ON_ERROR, DERIVATIVE_ON_MEASUREMENT, DERIVATIVE_FROM_RATE)
    assert dict(zip(DERIVATIVE_MODES, modes, strict=True)) == {
        "error": 0,
        "measurement": 1,
        "rate": 2,
    }
    strategies = (
        ANTIWINDUP_NONE,
        ANTIWINDUP_CONDITIONAL_INTEGRATION,
        ANTIWINDUP_BACK_CALCULATION,
    )
    assert [ANTIWINDUP_STRATEGIES[s] for s in strategies] == [
        "none",
        "conditional_integration",
        "back_calculation",
    ]


def test_every_parameter_reaches_the_law():
    config = build(
        PidConfig,
        {
            "derivative_mode": "measurement",
            "derivative_filter_time": 0.01,
            "u_clamp_min": -1.0,
            "u_clamp_max": inf,
            "i_clamp_min": -3.0,
            "i_clamp_max": 4,
            "antiwindup_strategy": "back_calculation",
            "tracking_time_constant": 0.5,
            "gains.p": 1.0,
            "gains.i": 2.0,
            "gains.d": 3.0,
        },
    )
    assert config.limits == Limits(1, 0.01, -1.0, inf, -3.0, 4.0, 2, 0.5)
    assert config.gains == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("config", BOTH)
def test_values_rebuild_their_configuration(config):
    assert build(config, values_of(config())) == config()


ROWS = ["S S S S S S S"] * 7
BAD_CELL = [*ROWS[:3], "S S S S S S MS", *ROWS[4:]]


@pytest.mark.parametrize(
    ("config", "name", "value", "allowed"),
    [
        (PidConfig, "gains.p", -60.0, "double, >= 0 and <= 1e+09"),
        (PidConfig, "gains.i", nan, "finite double, >= 0 and <= 1e+09"),
        (PidConfig, "gains.d", inf, "finite double, >= 0 and <= 1e+09"),
        (PidConfig, "gains.p_max", 1.0, "no such parameter; did you mean"),
        (PidConfig, "mass", 1.0, "no such parameter; trunk params lists them all"),
        (PidConfig, "update_rate", True, "double, >= 0.001 and <= 1e+06"),
        (PidConfig, "derivative_mode", "gyro", "string, one of error, measurement, rate"),
        (PidConfig, "antiwindup_strategy", "NONE", "string, one of none, conditional_integration"),
        (PidConfig, "u_clamp_max", -100.0, "greater than u_clamp_min (-100)"),
        (PidConfig, "i_clamp_max", -1.0, "double, >= 0"),
        (PidConfig, "i_clamp_min", 1.0, "double, <= 0"),
        (PidConfig, "reference.values", [1.0], "as many as reference.times (0)"),
        (
            PidConfig,
            "reference.profile",
            "ramp",
            "one of constant, step, sine, sequence, interpolated",
        ),
        (FuzzyPidConfig, "gains.p_max", 31.0, "at least gains.p_min (32)"),
        (FuzzyPidConfig, "gains.d_max", 9.0, "at least gains.d_min (9.6)"),
        (FuzzyPidConfig, "gains.d_min", 0.0, "double, > 0"),
        (FuzzyPidConfig, "fuzzy.error_range", 0.0, "double, > 0 and <= 1000"),
        (FuzzyPidConfig, "fuzzy.error_range", 1000.5, "double, > 0 and <= 1000"),
        (FuzzyPidConfig, "fuzzy.rate_range", 0.0, "double, > 0 and <= 100000"),
        (FuzzyPidConfig, "fuzzy.rate_peaks", [0.0, 1.5], "each >= -1 and <= 1"),
        (
            FuzzyPidConfig,
            "fuzzy.alpha_centers",
            [2.0, 3.0, 4.0],
            "as many as fuzzy.alpha_labels (4: ",
        ),
        (
            FuzzyPidConfig,
            "fuzzy.error_peaks",
            [-1.0, -0.5, -0.5, 0.0, 0.3, 0.6, 1.0],
            "strictly increasing peaks",
        ),
        (FuzzyPidConfig, "fuzzy.rate_peaks", [0.0], "double array of 2 to 64, each >= -1"),
        (
            FuzzyPidConfig,
            "rules.kp",
            BAD_CELL,
            "labels S, B, or numbers from 0 to 1; cell (e ZO, e_dot PB) is 'MS'",
        ),
        (FuzzyPidConfig, "rules.alpha", ["S S"] * 7, "7 labels in each row; row 1 (e NB) has 2"),
        (FuzzyPidConfig, "rules.kd", ROWS[:6], "7 rows, one per label of e; there are 6"),
        (FuzzyPidConfig, "fuzzy.kp_centers", [0.5], "as many as fuzzy.kp_labels (2: S, B)"),
        (FuzzyPidConfig, "fuzzy.kd_centers", [0.0, 1.5], "each >= 0 and <= 1"),
        (FuzzyPidConfig, "fuzzy.kp_labels", ["S", "S"], "S is there twice"),
        (FuzzyPidConfig, "fuzzy.rate_labels", ["N", "P"], "one label for each of the 7 peaks"),
    ],
)
def test_a_bad_value_is_refused_by_name_value_and_what_is_allowed(config, name, value, allowed):
    with pytest.raises(ParameterError) as caught:
        build(config, {name: value})
    assert caught.value.name == name
    message = str(caught.value)
    assert message.startswith(f"parameter {name!r}: {value!r}"[:60])
    assert allowed in message


def test_reference_times_must_ascend():
    values = {"reference.times": [2.0, 1.0], "reference.values": [0.1, 0.2]}
    with pytest.raises(ParameterError, match=r"'reference\.times': \[2\.0, 1\.0\].*ascending"):
        build(PidConfig, values)


def test_the_widest_and_the_narrowest_universes_are_taken():
    config = build(FuzzyPidConfig, {"fuzzy.error_range": 1e3, "fuzzy.rate_range": 0.5})
    assert config.peaks[0][-1] == 1e3
    assert config.peaks[1] == tuple(0.5 * peak for peak in config.rate_peaks)
