"""The normal distribution against mpmath: tails, the seams between methods, and round trips."""

from math import inf, isinf

import mpmath
import numpy as np
import pytest

from trunk_sim.noise import probability_below, quantile


def relative_error(x: float) -> float:
    with mpmath.workdps(40):
        exact = mpmath.ncdf(x)
        return float(abs(probability_below(x) - exact) / exact)


@pytest.mark.parametrize("x", [0.0, -0.0, 1e-9, 0.5, 1.0, 2.999, 3.0, 3.001, 6.0, 9.0, 40.0])
def test_the_distribution(x):
    assert relative_error(x) < 1e-15
    assert relative_error(-min(x, 30.0)) < 1e-13


def test_the_distribution_everywhere():
    assert max(relative_error(x) for x in np.linspace(-30.0, 9.0, 1500).tolist()) < 3e-13


def test_the_ends():
    assert probability_below(-inf) == 0.0
    assert probability_below(inf) == 1.0
    assert quantile(0.0) == -inf
    assert quantile(1.0) == inf
    assert quantile(0.5) == 0.0


def test_the_quantile_undoes_the_distribution():
    for x in np.linspace(-8.0, 5.0, 301).tolist():
        p = probability_below(x)
        density = np.exp(-x * x / 2.0) / np.sqrt(2.0 * np.pi)
        off = 3e-13 * p if x < -3.0 else 1e-15
        assert quantile(p) == pytest.approx(x, rel=2e-15, abs=off / density)


def test_every_probability_has_a_finite_quantile():
    assert not any(isinf(quantile(p)) for p in (2.0**-54, 2.0**-53, 1.0 - 2.0**-53))
