"""LQR: the default gains solve the Riccati equation; the feed-forward holds a leaning trunk."""

from math import inf, nan, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_are

from trunk_control.law import DERIVATIVE_FROM_RATE, Limits, Sample
from trunk_control.lqr import LqrConfig, lqr_update
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState

ANGLE = st.floats(-pi, pi)
FROM_RATE = Limits(derivative=DERIVATIVE_FROM_RATE)


def test_the_default_gains_solve_the_riccati_equation():
    inertia, weight = 0.5 * 1.0**2, 0.5 * 9.81 * 1.0
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, weight / inertia, 0.0]])
    b = np.array([[0.0], [0.0], [1.0 / inertia]])
    q = np.diag([0.1**-2, radians(6.0) ** -2, 1.0])
    r = np.array([[5.0**-2]])
    i, p, d = np.linalg.solve(r, b.T @ solve_continuous_are(a, b, q, r))[0]
    assert LqrConfig().gains == pytest.approx((p, i, d), rel=1e-5)
    assert LqrConfig().gravity_torque == pytest.approx(weight)


@given(ANGLE, ANGLE, st.floats(-5.0, 5.0))
def test_lqr_is_a_pid_with_feed_forward(reference, angle, rate):
    state, gains = PidState(0.02, started=True), Gains(61.0, 50.0, 9.0)
    sample = Sample(reference, angle, rate, 0.005)
    expected_state, expected = pid_update(state, *sample[:4], gains, FROM_RATE)
    state, terms = lqr_update(state, sample, (gains, 4.905), FROM_RATE)
    assert terms[:9] == expected[:9]
    assert terms.effort == pytest.approx(expected.effort - 4.905 * sin(reference), abs=1e-12)
    assert state.integral == expected_state.integral


def test_the_feed_forward_is_inside_the_limits():
    limits, constants = Limits(u_min=-3.0, u_max=3.0), (Gains(1.0, 0.0, 1.0), 4.9)
    _, terms = lqr_update(PidState(), Sample(pi / 2.0, pi / 2.0, 0.0, 0.01), constants, limits)
    assert (terms.unsaturated, terms.effort) == (-4.9, -3.0)


@pytest.mark.parametrize("bad", [(nan, 0.0), (0.1, inf)])
def test_a_bad_sample_holds_the_command(bad):
    state = PidState(effort=2.5, started=True)
    held, terms = lqr_update(state, Sample(0.0, *bad, 0.01), (Gains(1.0, 1.0, 1.0), 4.9), FROM_RATE)
    assert held is state
    assert terms.effort == 2.5
