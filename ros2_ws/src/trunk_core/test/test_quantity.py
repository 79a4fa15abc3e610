import math
from contextlib import suppress
from fractions import Fraction

import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.parameters.declarations import UnitError, looks_like_quantity
from trunk_core.parameters.quantity import SYMBOLS, parse_unit, read_quantity
from trunk_core.parameters.to_si import number_in

NUMBERS = st.decimals(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)
SIZES = {  # in SI units, by hand
    "ns": Fraction(1, 10**9), "us": Fraction(1, 10**6), "µs": Fraction(1, 10**6),
    "μs": Fraction(1, 10**6), "ms": Fraction(1, 1000), "s": 1, "min": 60, "h": 3600,
    "um": Fraction(1, 10**6), "µm": Fraction(1, 10**6), "μm": Fraction(1, 10**6),
    "mm": Fraction(1, 1000), "cm": Fraction(1, 100), "m": 1, "km": 1000,
    "mg": Fraction(1, 10**6), "g": Fraction(1, 1000), "kg": 1,
    "mrad": Fraction(1, 1000), "rad": 1, "deg": sympy.pi / 180, "°": sympy.pi / 180,
    "rev": 2 * sympy.pi, "rpm": 2 * sympy.pi / 60,
    "mHz": Fraction(1, 1000), "Hz": 1, "kHz": 1000, "MHz": 10**6,
    "mN": Fraction(1, 1000), "N": 1, "kN": 1000, "mNm": Fraction(1, 1000), "Nm": 1, "kNm": 1000,
    "%": Fraction(1, 100),
}  # fmt: skip


def test_every_symbol_has_its_size():
    assert SYMBOLS.keys() == SIZES.keys()
    for symbol, size in SIZES.items():
        unit = SYMBOLS[symbol]
        exact = sympy.Rational(unit.scale.numerator, unit.scale.denominator) * sympy.pi**unit.pi
        assert sympy.simplify(exact - sympy.sympify(size)) == 0, symbol


@given(NUMBERS, st.sampled_from([s for s in SIZES if SYMBOLS[s].pi == 0]))
def test_a_result_is_the_nearest_double(number, symbol):
    """The oracle is exact arithmetic: no double lies nearer to the result than the one returned."""
    unit = SYMBOLS[symbol]
    (si,) = [name for name in ("s", "m", "kg", "rad", "Hz", "N", "Nm", "1")
             if parse_unit(name).dimension == unit.dimension]  # fmt: skip
    found = read_quantity(f"{number} {symbol}", si)
    exact = Fraction(number) * Fraction(SIZES[symbol])
    error = abs(Fraction(found) - exact)
    for other in (math.nextafter(found, -math.inf), math.nextafter(found, math.inf)):
        assert error <= abs(Fraction(other) - exact)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("100ms", "s", 0.1),
        ("1kHz", "Hz", 1000.0),
        ("3 us", "s", 3e-6),
        ("9.6N*m/rad", "N m/rad", 9.6),
        ("9.6 N·m/rad", "N m/rad", 9.6),
        ("9.6Nm/rad", "N m/rad", 9.6),
        ("2 N m/(rad s)", "N m/(rad s)", 2.0),
        ("2 N m / rad / s", "N m/(rad s)", 2.0),
        ("2 N m rad^-1 s**-1", "N m/(rad s)", 2.0),
        ("3 N cm", "N m", 0.03),
        ("9.81 m/s²", "m/s^2", 9.81),
        ("100/s^2", "1/s^2", 100.0),
        ("100 1/s^2", "1/s^2", 100.0),
        ("  -5  ms ", "s", -0.005),
        ("+.5e1 m", "m", 5.0),
        ("inf N m", "N m", math.inf),
        ("-.inf N m", "N m", -math.inf),
        ("1e-400 s", "s", 0.0),
        ("80%", "", 0.8),
        ("80 %/s", "1/s", 0.8),
        ("6 deg", "deg", 6.0),
        ("60 rpm", "rad/s", 2 * math.pi),
        ("180 N m/rad", "N m/deg", math.pi),
    ],
)
def test_numbers_with_units(text, unit, value):
    assert read_quantity(text, unit) == value


def test_a_zero_keeps_its_sign():
    assert math.copysign(1.0, read_quantity("-0 ms", "s")) == -1.0
    assert math.copysign(1.0, read_quantity("-0 deg", "rad")) == -1.0


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_degrees_have_the_bits_of_math_radians(degrees):
    assert read_quantity(f"{degrees!r}deg", "rad") == math.radians(degrees)
    assert read_quantity(f"{degrees!r} deg/s", "rad/s") == math.radians(degrees)


@given(st.floats(allow_nan=False) | st.integers(-(10**30), 10**30))
def test_a_plain_number_is_not_a_quantity_and_stays_as_it_is(number):
    assert not looks_like_quantity(repr(number))
    assert number_in(repr(number), "s") == float(number) == number_in(number, "s")


TOKENS = ("5", "1", "s", "ms", "N", "m", "/", "*", "^2", "(", ")", "rad", "%", "²", "e", "0")
REFUSED = {
    "another dimension": ("5kg", "s", "it is a mass; a time in s is needed, such as 5 s or 5 ms"),
    "a torque is no gain": ("5 N m", "N m/rad", "it is a torque; a quantity in N m/rad is needed"),
    "a gain is no torque": ("5 N m/rad", "N m", "it is a quantity in N m/rad; a torque in N m"),
    "a frequency is no angular speed": ("5 Hz", "rad/s", "it is a frequency; an angular speed"),
    "an angular speed is no frequency": ("60rpm", "Hz", "it is an angular speed; a frequency"),
    "a ratio is no time": ("50%", "s", "it is a ratio; a time"),
    "a unit where there is none": ("5 s", "", "a plain number is needed, or a percentage"),
    "a declared unit that is not known": ("5 V", "V", "does not convert to 'V': give a plain"),
    "a word": ("5 seconds", "s", "there is no unit 'seconds'; a time in s"),
    "another case": (
        "5 KHZ",
        "Hz",
        "no unit 'KHZ'; a frequency in Hz is needed, such as 5 Hz or 5 kHz",
    ),
    "something else": ("5 parsecs", "m", "there is no unit 'parsecs'; a length in m is needed"),
    "two readings": ("5 N m/rad s", "N m/(rad s)", "can be read in two ways"),
    "two readings, with a sign": ("5 N*m/rad*s", "N m/(rad s)", "can be read in two ways"),
    "an open parenthesis": ("5 N m/(rad s", "N m/(rad s)", "can be read in two ways"),
    "a closing parenthesis": ("5 s)", "s", "no unit 's)'"),
    "no unit after a sign": ("5 m/", "m", "no unit ''"),
    "a power alone": ("5 ^2", "s", "no unit '^2'"),
    "a percent of a percent": ("50%%", "", "no unit '%%'"),
    "a percentage of a unit": ("5 m%", "m", "no unit 'm%'"),
    "a digit in the unit": ("5 m1", "m", "no unit 'm1'"),
    "a digit before the unit": ("5 1 m", "m", "no unit '1'"),
    "two powers": ("5 s^2^3", "s", "no unit 's^2^3'"),
    "a large power": ("5 s^99999999999", "s", "no unit 's^99999999999'"),
    "a strange sign": ("5 s;", "s", "no unit 's;'"),
    "a hexadecimal number": ("0x10 s", "s", "no unit 'x10'"),
    "a number without a unit": ("500", "s", "it is not a number"),
    "too large": ("1e308 km", "m", "larger than any double"),
    "too many degrees": ("1e400 deg", "rad", "larger than any double"),
    "an exponent that takes all memory": ("1e999999999 s", "s", "beyond what a double can hold"),
    "too long a text": (f"{'1' * 101} s", "s", "103 characters: at most 100"),
}


@pytest.mark.parametrize(("text", "unit", "says"), REFUSED.values(), ids=REFUSED.keys())
def test_refused_in_one_line(text, unit, says):
    with pytest.raises(UnitError) as caught:
        read_quantity(text, unit)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=30))
def test_any_text_is_a_unit_or_refused(text):
    with suppress(UnitError):  # any other exception fails the test
        assert parse_unit(text).scale > 0


@given(st.lists(st.sampled_from(TOKENS), max_size=25))
def test_any_sequence_of_tokens_is_a_unit_or_refused(tokens):
    with suppress(UnitError):
        assert parse_unit(" ".join(tokens)).scale > 0
