"""The controllers' parameters: defaults and refusals."""

from math import inf, pi

import pytest

from trunk_control.fuzzy_pid import FuzzyPidConfig, GainBox
from trunk_control.law import (
    ANTIWINDUP_CONDITIONAL_INTEGRATION,
    DERIVATIVE_FROM_RATE,
    Limits,
)
from trunk_control.pid import PidConfig
from trunk_control.pid_family import Gains
from trunk_control.rule_tables import ALPHA_AS_PRINTED
from trunk_core.parameters.declarations import build, values_of

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


def test_the_widest_and_the_narrowest_universes_are_taken():
    config = build(FuzzyPidConfig, {"fuzzy.error_range": 1e3, "fuzzy.rate_range": 0.5})
    assert config.peaks[0][-1] == 1e3
    assert config.peaks[1] == tuple(0.5 * peak for peak in config.rate_peaks)
