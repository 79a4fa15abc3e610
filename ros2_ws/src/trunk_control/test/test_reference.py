"""Reference profiles at and around their switching times, and between their points."""

from math import pi, sin

import pytest

from trunk_control.pid import PidConfig
from trunk_control.reference import reference_at

SECOND = 1_000_000_000


def profile(kind: str, **values):
    return PidConfig(
        reference_profile=kind, **{f"reference_{name}": value for name, value in values.items()}
    ).reference


def test_constant():
    constant = profile("constant", value=0.3, initial=9.0)
    assert [reference_at(t, constant) for t in (0, 1, 10**12)] == [0.3] * 3


@pytest.mark.parametrize(
    ("t_ns", "expected"),
    [(0, 0.1), (2 * SECOND - 1, 0.1), (2 * SECOND, pi / 4.0), (9 * SECOND, pi / 4.0)],
)
def test_the_step_comes_at_its_time(t_ns, expected):
    assert (
        reference_at(t_ns, profile("step", value=pi / 4.0, initial=0.1, step_time=2.0)) == expected
    )


@pytest.mark.parametrize("t", [0.0, 0.125, 0.7, 33.3])
def test_sine(t):
    sine = profile("sine", value=0.5, amplitude=0.25, frequency=2.0)
    expected = 0.5 + 0.25 * sin(4.0 * pi * t)
    assert reference_at(round(t * SECOND), sine) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("t_ns", "expected"),
    [
        (0, 0.1),
        (SECOND - 1, 0.1),
        (SECOND, 0.2),
        (3 * SECOND - 1, 0.2),
        (3 * SECOND, -0.3),
        (99 * SECOND, -0.3),
    ],
)
def test_sequence_holds_each_level_until_the_next(t_ns, expected):
    levels = profile("sequence", initial=0.1, times=(1.0, 3.0), values=(0.2, -0.3))
    assert reference_at(t_ns, levels) == expected


def test_an_empty_sequence_stays_at_the_initial_level():
    assert reference_at(SECOND, profile("sequence", initial=0.4)) == 0.4


@pytest.mark.parametrize(
    ("t_ns", "expected"),
    [
        (0, 0.25),
        (SECOND, 0.25),
        (3 * SECOND // 2, 0.0),
        (2 * SECOND, -0.25),
        (4 * SECOND - 1, pytest.approx(0.75, abs=1e-8)),
        (4 * SECOND, 0.75),
        (99 * SECOND, 0.75),
    ],
)
def test_interpolated_goes_straight_from_point_to_point_and_stays(t_ns, expected):
    points = profile("interpolated", initial=9.0, times=(1.0, 2.0, 4.0), values=(0.25, -0.25, 0.75))
    assert reference_at(t_ns, points) == expected


def test_one_point_is_a_constant():
    point = profile("interpolated", times=(1.0,), values=(0.5,))
    assert {reference_at(t * SECOND, point) for t in range(3)} == {0.5}
