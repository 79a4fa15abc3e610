import json
from dataclasses import replace
from math import degrees, inf, radians

import numpy as np
import pytest

from trunk_evidence.run_metrics import QUANTITIES, SETTLING_BAND
from trunk_evidence.run_table import RunTable, metrics


def table(theta, reference=0.0, torque=0.0, period=0.01) -> RunTable:
    theta = np.asarray(theta, float)
    t = np.arange(len(theta)) * period
    columns = {"t": t, "theta": theta}
    for name, value in (("reference", reference), ("torque", torque)):
        columns[name] = np.broadcast_to(np.asarray(value, float), t.shape)
    names = RunTable.__dataclass_fields__
    return RunTable(**{name: columns.get(name, np.full(t.shape, np.nan)) for name in names})


def test_keys():
    assert list(metrics(table([0.0] * 5)).as_dict()) == [
        "overshoot_deg",
        "settling_time_6deg_s",
        "steady_state_error_mean_deg",
        "steady_state_error_rms_deg",
        "iae",
        "ise",
        "itae",
        "effort",
        "peak_torque",
        "theta_min_deg",
        "theta_max_deg",
    ]
    json.dumps(metrics(table([0.1] * 500)).as_dict(), allow_nan=False)


def test_integrals_of_a_straight_line_are_those_of_calculus():
    # theta falls from 1 to -1 in 2 s: |e| is two triangles, e^2 = (1 - t)^2
    result = metrics(table(np.linspace(1.0, -1.0, 2001), period=0.001))
    assert result.iae == pytest.approx(1.0, rel=1e-6)
    assert result.ise == pytest.approx(2.0 / 3.0, rel=1e-6)
    assert result.itae == pytest.approx(1.0, rel=1e-6)  # by symmetry about t = 1
    assert (result.theta_min_deg, result.theta_max_deg) == (degrees(-1.0), degrees(1.0))


def test_integrals_of_a_constant_error():
    result = metrics(table(np.full(2001, -0.25), period=0.001))
    integrals = (result.iae, result.ise, result.itae)
    assert integrals == pytest.approx((0.25 * 2.0, 0.25**2 * 2.0, 0.25 * 2.0**2 / 2.0))


def test_effort_is_the_integral_of_the_held_torque_squared():
    result = metrics(table([0.0] * 4, torque=[1.0, -2.0, 4.0, 100.0], period=0.5))
    assert result.effort == 0.5 * (1.0 + 4.0 + 16.0)
    assert result.peak_torque == 100.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_is_relative_to_the_angle_at_the_change(sign):
    theta = np.concatenate([np.full(100, 0.9), np.full(100, 0.0), np.full(300, 0.6)])
    reference = np.where(np.arange(500) < 100, 0.0, 0.5)
    result = metrics(table(sign * theta, sign * reference))
    # At the step the angle is 0.0: the 0.9 before it does not count.
    assert result.overshoot_deg == pytest.approx(degrees(0.1))
    assert metrics(table(sign * np.linspace(1.0, 0.2, 500))).overshoot_deg == 0.0
    assert metrics(table(np.zeros(500))).overshoot_deg is None


def test_settling_counts_from_the_last_change_to_the_last_time_outside():
    theta = np.zeros(601)
    reference = np.where(np.arange(601) < 200, 0.0, 1.0)
    theta[250:] = 1.0
    theta[300] = 1.0 + radians(6.1)
    theta[400] = 1.0 + radians(5.9)
    assert metrics(table(theta, reference)).settling_time_6deg_s == pytest.approx(1.01)
    theta[500] = 1.0 - radians(6.1)  # leaves 0.99 s
    assert metrics(table(theta, reference)).settling_time_6deg_s == inf
    theta[500] = 1.0
    theta[499] = 1.0 - radians(6.1)  # leaves 1.00 s
    assert metrics(table(theta, reference)).settling_time_6deg_s == pytest.approx(3.0)
    assert metrics(table(np.zeros(601))).settling_time_6deg_s == 0.0
    assert metrics(table(np.full(601, SETTLING_BAND))).settling_time_6deg_s == 0.0
    assert metrics(table(np.ones(601))).settling_time_6deg_s == inf


def test_steady_state_is_the_last_two_seconds():
    theta = np.where(np.arange(501) < 300, 5.0, -0.1)
    theta[-1] = 0.1
    result = metrics(table(theta, 0.0))
    assert result.steady_state_error_mean_deg == pytest.approx(degrees(0.1 * 199 / 201))
    assert result.steady_state_error_rms_deg == pytest.approx(degrees(0.1))
    short = metrics(table(theta[:200]))
    assert (short.steady_state_error_mean_deg, short.steady_state_error_rms_deg) == (None, None)
    assert metrics(table(theta[:201])).steady_state_error_mean_deg is not None


def test_times_count_from_the_start_of_the_run():
    theta = np.where(np.arange(301) < 50, 1.0, 0.0)
    run = table(theta)
    late = metrics(replace(run, t=run.t + 5.0))
    assert late.settling_time_6deg_s == pytest.approx(0.5)
    assert late.steady_state_error_rms_deg == 0.0
    short = table(theta[:150])
    assert metrics(replace(short, t=short.t + 5.0)).steady_state_error_rms_deg is None


def test_extreme_angles_are_reported_and_not_ranked():
    told = {name for name, quantity in QUANTITIES.items() if not quantity.ranked}
    assert told == {"theta_min_deg", "theta_max_deg"}


def test_a_sequence_counts_by_its_last_level_and_a_moving_reference_has_none():
    levels = np.repeat([0.3, -0.2, 0.5], 200)
    theta = np.roll(levels, 10)
    theta[:10] = 0.3
    result = metrics(table(theta, levels))
    assert result.overshoot_deg == 0.0
    assert result.settling_time_6deg_s == pytest.approx(0.1)
    late = metrics(table(theta[:450], levels[:450]))  # half a second at the last level
    sine = metrics(table(np.zeros(600), 0.01 * np.sin(np.arange(600) / 50.0)))
    for moving in (late, sine):
        assert moving.overshoot_deg is None
        assert moving.settling_time_6deg_s is None
    assert sine.iae > 0.0


def test_a_level_counts_from_one_second_on_and_a_constant_reference_always():
    assert metrics(table(np.linspace(1.0, 0.2, 50))).overshoot_deg == 0.0
    reference = np.where(np.arange(201) < 100, 0.0, 1.0)
    whole = metrics(table(np.zeros(201), reference))  # 1.00 s
    assert whole.overshoot_deg == 0.0
    assert metrics(table(np.zeros(200), reference[:200])).overshoot_deg is None


@pytest.mark.parametrize("column", ["theta", "reference", "torque"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_non_finite_data_are_named(column, value):
    columns = {"theta": np.zeros(9), "reference": np.zeros(9), "torque": np.zeros(9)}
    columns[column][[3, 5]] = value  # the first is named
    with pytest.raises(ValueError, match=f"^{column} is not finite at t = 0.03 s: no metrics$"):
        metrics(table(**columns))


def test_without_a_reference_from_the_start_there_are_no_metrics():
    with pytest.raises(ValueError, match="no controller of ours has published its reference"):
        metrics(table(np.zeros(9), np.array([np.nan] + [0.0] * 8)))


def test_one_state_is_enough_for_metrics():
    assert metrics(table([0.1])).iae == 0.0
    with pytest.raises(ValueError, match="at least one state"):
        metrics(table([]))
