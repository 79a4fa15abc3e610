"""The equations of motion where hand calculations are easy, and where floats end."""

import random
from math import cos, inf, isnan, sin

import mpmath
import pytest

from trunk_core.elementary import sincos
from trunk_core.mechanics import (
    MOST_HARMONICS,
    Body,
    equations_of_motion,
    forward_dynamics,
    harmonics_at,
    harmonics_of,
    inverse_dynamics,
    path_height,
    path_slope,
    prescribed_dynamics,
)

UPRIGHT = (0.0, 0.0, 0.0, 0.0)
FLAT = Body(hip_mass=1.0, trunk_mass=1.0, length=1.0, gravity=0.0, amplitude=0.0)


def test_the_path_is_a_sine_and_its_slope_the_derivative():
    assert path_height(0.3, 2.0, 5.0) == 2.0 * sin(1.5)
    assert path_slope(0.3, 2.0, 5.0) == pytest.approx(10.0 * cos(1.5), rel=1e-15)


def test_harmonics_are_pairs_filled_up_with_zeros():
    assert harmonics_of((), ()) is None
    assert harmonics_of((0.0, -0.0), (0.0,)) is None
    assert harmonics_of((1.0,), (2.0, 3.0)) == (1.0, 2.0, 0.0, 3.0)
    assert harmonics_of((0.0, 5.0, 0.0), ()) == (0.0, 0.0, 5.0, 0.0)
    assert harmonics_of((), (7.0,)) == (0.0, 7.0)


def derivatives(phase, wavenumber, harmonics):
    """Return y, y' and y'' of a Fourier series by mpmath's own derivatives, and each one's scale."""

    def y(x):
        return sum(
            (mpmath.cos, mpmath.sin)[i % 2](one * (i // 2 + 1) * wavenumber * x) * coefficient
            for one in (mpmath.mpf(1),)
            for i, coefficient in enumerate(harmonics)
        )

    exact = [mpmath.diff(y, mpmath.mpf(phase) / wavenumber, order) for order in range(3)]
    waves = [((i // 2 + 1) * wavenumber, abs(one)) for i, one in enumerate(harmonics)]
    return exact, [sum(size * wave**order for wave, size in waves) for order in range(3)]


def test_height_slope_and_curvature_of_harmonics_are_the_exact_derivatives():
    some = random.Random(7)
    for count in (1, 2, 3, 5, 8, MOST_HARMONICS):
        for _ in range(8):
            harmonics = [some.uniform(-0.1, 0.1) for _ in range(2 * count)]
            k, phase = some.uniform(0.1, 10.0), some.uniform(-50.0, 50.0)
            found = harmonics_at(*sincos(phase), k, harmonics)
            with mpmath.workdps(60):
                exact, scale = derivatives(phase, k, harmonics)
            for one, expected, size in zip(found, exact, scale, strict=True):
                assert one == pytest.approx(float(expected), rel=0.0, abs=1e-14 * size)


def test_harmonics_are_added_to_the_sine():
    path = (0.3, 2.0, 5.0)
    harmonics = (0.1, -0.2, 0.3, 0.4)
    height, slope, _ = harmonics_at(*sincos(1.5), 5.0, harmonics)
    assert path_height(*path, harmonics) == path_height(*path) + height
    assert path_slope(*path, harmonics) == path_slope(*path) + slope
    assert (height, slope) != (0.0, 0.0)


def test_the_first_sine_has_the_bits_of_the_amplitude():
    some = random.Random(3)
    for _ in range(200):
        amplitude, k, *state = (some.uniform(-3.0, 3.0) for _ in range(6))
        plain = Body(amplitude=amplitude, wavenumber=k)
        series = Body(amplitude=0.0, wavenumber=k, harmonics=(0.0, amplitude))
        assert equations_of_motion(*state, series) == equations_of_motion(*state, plain)


def test_two_equal_masses_on_a_flat_path():
    # (M + m) x'' + m l theta'' = F, m l x'' + m l^2 theta'' = tau: x'' = F - tau, theta'' = 2 tau - F.
    assert equations_of_motion(*UPRIGHT, FLAT) == (2.0, 1.0, 1.0, 0.0, 0.0, 1.0)
    assert forward_dynamics(*UPRIGHT, 3.0, 5.0, FLAT) == (-2.0, 7.0)
    assert inverse_dynamics(*UPRIGHT, FLAT) == (0.5, 0.0)


def test_a_prescribed_hip_leaves_the_pendulum():
    assert prescribed_dynamics(*UPRIGHT, 5.0, FLAT) == (0.0, 5.0)
    assert inverse_dynamics(*UPRIGHT, FLAT, prescribed=True) == (1.0, 0.0)


def test_masses_that_add_up_to_one():
    light = FLAT._replace(hip_mass=0.5, trunk_mass=0.5)
    inertia, bias = inverse_dynamics(*UPRIGHT, light)
    assert (inertia, bias) == (0.25, 0.0)  # (0.5 * 0.5) / 1


def test_what_is_too_small_for_floats_has_no_acceleration():
    tiny = FLAT._replace(hip_mass=5e-324, trunk_mass=5e-324, length=0.1)
    assert isnan(forward_dynamics(*UPRIGHT, 0.0, 1.0, tiny)[1])
    assert isnan(prescribed_dynamics(*UPRIGHT, 1.0, tiny)[1])
    massless = tiny._replace(hip_mass=0.0, trunk_mass=0.0)
    assert all(map(isnan, inverse_dynamics(*UPRIGHT, massless)))


@pytest.mark.parametrize("x", [0.0, inf])
@pytest.mark.parametrize("theta", [0.0, -inf])
def test_an_angle_that_is_not_finite_gives_no_acceleration_and_no_torque(x, theta):
    found = [
        forward_dynamics(x, theta, 0.0, 0.0, 0.0, 0.0, Body())[1],
        prescribed_dynamics(x, theta, 0.0, 0.0, 0.0, Body())[1],
        *(inverse_dynamics(x, theta, 0.0, 0.0, Body(), kind)[1] for kind in (False, True)),
    ]
    assert [isnan(one) for one in found] == [x != 0.0 or theta != 0.0] * 4
