"""A closed loop around a linear plant, against a textbook loop.

The plant is theta'' = u / J, exactly discretised for a held input, J = m l^2 = 0.5 kg m^2.
"""

import numpy as np
import pytest

from trunk_control.law import Limits
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState

J, H, STEPS = 0.5, 0.005, 2000
GAINS = Gains(60.0, 100.0, 9.0)


def reference(k: int) -> float:
    return 0.0 if k < 10 else 0.8


def plant(theta: float, rate: float, u: float) -> tuple[float, float]:
    return theta + H * rate + 0.5 * H * H * u / J, rate + H * u / J


def loop(law: Limits) -> tuple[np.ndarray, np.ndarray]:
    theta, rate, state = 0.1, 0.2, PidState()
    angles, efforts = [], []
    for k in range(STEPS):
        state, terms = pid_update(state, reference(k), theta, rate, H, GAINS, law)
        angles.append(theta)
        efforts.append(terms.effort)
        theta, rate = plant(theta, rate, terms.effort)
    return np.array(angles), np.array(efforts)


def textbook(mode: str, filter_time: float, limit: float, clamping: bool):
    """The same loop as textbooks print it: one pass, plain variables, no functions."""
    theta, rate = 0.1, 0.2
    integral, filtered, old_error, old_theta = 0.0, 0.0, None, None
    angles, efforts = [], []
    for k in range(STEPS):
        error = reference(k) - theta
        old_integral = integral
        integral = integral + error * H
        if mode == "rate":
            derivative = -rate
        elif old_error is None:
            derivative = 0.0
        elif mode == "error":
            derivative = (error - old_error) / H
        else:
            derivative = -(theta - old_theta) / H
        if filter_time:
            filtered = (filter_time * filtered + H * derivative) / (filter_time + H)
            derivative = filtered
        u = 60.0 * error + 100.0 * integral + 9.0 * derivative
        applied = min(max(u, -limit), limit)
        if clamping and applied != u and np.sign(u) == np.sign(error):
            integral = old_integral
        old_error, old_theta = error, theta
        angles.append(theta)
        efforts.append(applied)
        theta, rate = plant(theta, rate, applied)
    return np.array(angles), np.array(efforts)


@pytest.mark.parametrize("clamping", [False, True], ids=["free", "conditional_integration"])
@pytest.mark.parametrize("filter_time", [0.0, 0.01], ids=["unfiltered", "filtered"])
@pytest.mark.parametrize("mode", ["error", "measurement", "rate"])
def test_loop_equals_the_textbook_loop(mode, filter_time, clamping):
    limit = 8.0 if clamping else float("inf")
    derivative = ("error", "measurement", "rate").index(mode)
    law = Limits(derivative, filter_time, u_min=-limit, u_max=limit, antiwindup=int(clamping))
    angles, efforts = loop(law)
    expected_angles, expected_efforts = textbook(mode, filter_time, limit, clamping)
    assert np.abs(angles).max() < 3.0  # the loop is stable, so the comparison is meaningful
    assert angles == pytest.approx(expected_angles, abs=1e-11)
    assert efforts == pytest.approx(expected_efforts, abs=1e-8)
