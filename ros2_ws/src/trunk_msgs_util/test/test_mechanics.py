"""The equations of motion where hand calculations are easy, and where floats end."""

from __future__ import annotations

from math import cos, inf, isnan, sin

import pytest

from trunk_msgs_util.mechanics import (
    Body,
    equations_of_motion,
    forward_dynamics,
    inverse_dynamics,
    path_height,
    path_slope,
)

UPRIGHT = (0.0, 0.0, 0.0, 0.0)
FLAT = Body(hip_mass=1.0, trunk_mass=1.0, length=1.0, gravity=0.0, amplitude=0.0)


def test_the_path_is_a_sine_and_its_slope_the_derivative():
    assert path_height(0.3, 2.0, 5.0) == 2.0 * sin(1.5)
    assert path_slope(0.3, 2.0, 5.0) == pytest.approx(10.0 * cos(1.5), rel=1e-15)


def test_two_equal_masses_on_a_flat_path():
    # (M + m) x'' + m l theta'' = F, m l x'' + m l^2 theta'' = tau: x'' = F - tau, theta'' = 2 tau - F.
    assert equations_of_motion(*UPRIGHT, FLAT) == (2.0, 1.0, 1.0, 0.0, 0.0, 1.0)
    assert forward_dynamics(*UPRIGHT, 3.0, 5.0, FLAT) == (-2.0, 7.0)
    assert inverse_dynamics(*UPRIGHT, FLAT) == (0.5, 0.0)


def test_a_prescribed_hip_leaves_the_pendulum():
    prescribed = FLAT._replace(prescribed=True)
    assert forward_dynamics(*UPRIGHT, 3.0, 5.0, prescribed) == (0.0, 5.0)
    assert inverse_dynamics(*UPRIGHT, prescribed) == (1.0, 0.0)


def test_masses_that_add_up_to_one():
    light = FLAT._replace(hip_mass=0.5, trunk_mass=0.5)
    inertia, bias = inverse_dynamics(*UPRIGHT, light)
    assert (inertia, bias) == (0.25, 0.0)  # (0.5 * 0.5) / 1


@pytest.mark.parametrize("prescribed", [False, True])
def test_what_is_too_small_for_floats_has_no_acceleration(prescribed):
    tiny = FLAT._replace(hip_mass=5e-324, trunk_mass=5e-324, length=0.1, prescribed=prescribed)
    assert isnan(forward_dynamics(*UPRIGHT, 0.0, 1.0, tiny)[1])
    if not prescribed:
        assert all(
            map(isnan, inverse_dynamics(*UPRIGHT, tiny._replace(hip_mass=0.0, trunk_mass=0.0)))
        )


@pytest.mark.parametrize("x", [0.0, inf])
@pytest.mark.parametrize("theta", [0.0, -inf])
@pytest.mark.parametrize("prescribed", [False, True])
def test_an_angle_that_is_not_finite_gives_no_acceleration_and_no_torque(x, theta, prescribed):
    body = Body(prescribed=prescribed)
    found = [
        forward_dynamics(x, theta, 0.0, 0.0, 0.0, 0.0, body)[1],
        inverse_dynamics(x, theta, 0.0, 0.0, body)[1],
    ]
    assert [isnan(one) for one in found] == [x != 0.0 or theta != 0.0] * 2
