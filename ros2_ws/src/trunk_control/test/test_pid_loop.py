"""A closed loop around a linear plant, against a textbook loop and against its closed form.

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


def test_loop_equals_its_closed_form():
    # State [theta, rate, I, y_{k-1}], derivative on the measurement: x_{k+1} = A x_k + B r.
    kp, ki, kd = GAINS
    row = np.array([-kp - ki * H - kd / H, 0.0, ki, kd / H])  # u = row x + (kp + ki h) r
    drive = np.array([0.5 * H * H / J, H / J, 0.0, 0.0])
    free = np.array([[1, H, 0, 0], [0, 1, 0, 0], [-H, 0, 1, 0], [1, 0, 0, 0]], dtype=float)
    a = free + np.outer(drive, row)
    b = drive * (kp + ki * H) + np.array([0.0, 0.0, H, 0.0])
    poles, modes = np.linalg.eig(a)
    assert np.abs(poles).max() < 1.0
    rest = np.linalg.solve(np.eye(4) - a, b * 0.8)
    start = np.linalg.solve(modes, np.array([0.1, 0.2, 0.0, 0.1]) - rest)
    k = np.arange(STEPS)
    closed_form = (modes[0] * start * poles ** k[:, None]).sum(axis=1).real + rest[0]

    theta, rate, state = 0.1, 0.2, PidState()
    angles = []
    for _ in k:
        state, terms = pid_update(state, 0.8, theta, rate, H, GAINS, Limits(derivative=1))
        angles.append(theta)
        theta, rate = plant(theta, rate, terms.effort)
    assert angles == pytest.approx(closed_form, abs=1e-9)
    assert angles[-1] == pytest.approx(0.8, abs=1e-3)
