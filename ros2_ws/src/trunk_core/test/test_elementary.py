"""The project's own elementary functions: within 1 or 2 ULP, with the same bits everywhere."""

import math
import random
from itertools import product

import mpmath
import pytest

from trunk_core import elementary
from trunk_core.elementary import LARGEST_ANGLE, atan2, cos, exp, log, sin, sincos, sqrt, tanh

POINTS = 4000  # of each sort
FUNCTIONS = {"sin": sin, "cos": cos, "exp": exp, "log": log}


def points(name):
    """Return arguments over the function's whole domain, most of them where errors are largest."""
    some = random.Random(name)
    many = range(POINTS)

    def magnitudes(low, high):
        return [some.choice((-1, 1)) * 10 ** some.uniform(low, high) for _ in many]

    if name == "exp":
        found = [some.uniform(-708, 709) for _ in many] + [some.uniform(-1, 1) for _ in many]
        return found + magnitudes(-300, 2)
    if name == "log":
        near = [1 + some.uniform(-1, 1) * 2.0 ** -some.randrange(1, 50) for _ in many]
        return near + [some.uniform(0, 2) for _ in many] + [abs(x) for x in magnitudes(-307, 308)]
    quarters = [some.randrange(1, 2**20) * (math.pi / 2) for _ in many]
    near = [k * (math.pi / 2) * (1 + d * 2.0**-52) for k in range(1, POINTS // 3) for d in (-1, 1)]
    return [some.uniform(-1e6, 1e6) for _ in many] + quarters + near + magnitudes(-300, 6)


@pytest.mark.slow
@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_error_is_below_one_unit_in_the_last_place(name):
    true, ours = getattr(mpmath, name), FUNCTIONS[name]
    with mpmath.workprec(200):
        for x in points(name):
            expected = true(mpmath.mpf(x))
            unit = math.ulp(float(expected))
            assert abs(mpmath.mpf(ours(x)) - expected) < unit, x.hex()


@pytest.mark.parametrize(
    ("function", "x", "expected"),
    [
        (sin, 0.0, "0.0"),
        (sin, -0.0, "-0.0"),
        (sin, 5e-324, "5e-324"),
        (sin, -1e-300, "-1e-300"),
        (cos, 0.0, "1.0"),
        (cos, -0.0, "1.0"),
        (exp, 0.0, "1.0"),
        (exp, -0.0, "1.0"),
        (exp, -708.1, "0.0"),
        (exp, 709.1, "inf"),
        (log, 1.0, "0.0"),
        (log, 0.0, "nan"),
        (log, -1.0, "nan"),
        (log, 5e-324, "nan"),
        *((f, x, "nan") for f in (sin, cos, log) for x in (math.inf, -math.inf, math.nan)),
        *((f, math.nan, "nan") for f in (exp, tanh, sqrt)),
        (exp, math.inf, "inf"),
        (exp, -math.inf, "0.0"),
        (tanh, math.inf, "1.0"),
        (tanh, -math.inf, "-1.0"),
        (tanh, -0.0, "-0.0"),
        (sqrt, -0.0, "-0.0"),
        (sqrt, -1e-300, "nan"),
        (sqrt, math.inf, "inf"),
        *((f, x, "nan") for f in (sin, cos) for x in (LARGEST_ANGLE + 1, -1e300)),
    ],
)
def test_ends_signs_and_zeros(function, x, expected):
    assert repr(function(x)) == expected


def test_hyperbolic_and_inverse_tangents_are_within_two_units_in_the_last_place():
    some = random.Random(5)
    with mpmath.workprec(200):
        for _ in range(POINTS):
            x = some.choice((-1, 1)) * 2.0 ** some.uniform(-30, 5)
            y = some.choice((x * some.uniform(-3, 3), 2.0 ** some.uniform(-40, 40)))
            for found, true in ((tanh(x), mpmath.tanh(x)), (atan2(y, x), mpmath.atan2(y, x))):
                assert abs(mpmath.mpf(found) - true) < 2 * math.ulp(float(true)), (y.hex(), x.hex())


def test_an_angle_has_the_signs_of_c():
    odd = (0.0, 1.0, math.inf, 5e-324, 1e308)
    for y, x in product((*odd, *(-v for v in odd)), repeat=2):
        found, expected = atan2(y, x), math.atan2(y, x)
        assert found == pytest.approx(expected, rel=4e-16, abs=0.0)
        assert math.copysign(1.0, found) == math.copysign(1.0, expected)
    assert math.isnan(atan2(math.nan, 1.0))
    assert math.isnan(atan2(1.0, math.nan))


@pytest.mark.parametrize("turns", [0.0, 0.25, 1234.75, -3.125, 1e15])
def test_a_sine_wave_may_go_on_for_ever(turns):
    expected = math.sin(2.0 * math.pi * (turns % 1.0) + 0.5)
    assert elementary.sine_wave(turns, 0.5) == pytest.approx(expected, rel=1e-15)


def test_odd_and_even():
    for x in points("sin"):
        s, c = sincos(x)
        assert sincos(-x) == (-s, c)


@pytest.mark.slow
def test_compiled_code_returns_the_same_bits():
    numba = pytest.importorskip("numba")
    numba.extending.register_jitable(sincos)
    for name, ours in FUNCTIONS.items():
        compiled = numba.njit(ours)
        found = [(ours(x).hex(), compiled(x).hex(), x.hex()) for x in points(name)]
        assert [one for one in found if one[0] != one[1]] == []
