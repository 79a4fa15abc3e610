"""A number with a unit, as text: ``45 deg``, ``100ms``, ``9.6N*m/rad``, in the unit that is asked for.

Units are written out, such as ``N m/(rad s)``. The angle counts as a quantity of its own. A torque (N m)
is thus not a gain (N m/rad), and a frequency (Hz) not an angular speed (rad/s): between those a factor of
2 pi is easily lost.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

from .declarations import QUANTITY, UnitError

_LONGEST = 100  # characters
_LARGEST_EXPONENT = 400
# Far more digits than the rounding of a result can depend on.
_PI = Fraction(
    "3.1415926535897932384626433832795028841971693993751058209749445923078164062862089986280348253"
    "421170679821480865132823066470938446095505822317253594081284811174502841027019385211055596446"
)
# The powers of mass, length, time and angle; that of pi in the sizes; symbols, and their sizes in SI units.
_QUANTITIES = (
    ("a ratio", (0, 0, 0, 0), 0, "%=1/100"),
    ("a mass", (1, 0, 0, 0), 0, "kg=1 g=1e-3 mg=1e-6"),
    ("a length", (0, 1, 0, 0), 0, "m=1 km=1e3 cm=1e-2 mm=1e-3 um=1e-6 µm=1e-6 μm=1e-6"),
    ("a time", (0, 0, 1, 0), 0, "s=1 ms=1e-3 us=1e-6 µs=1e-6 μs=1e-6 ns=1e-9 min=60 h=3600"),
    ("an angle", (0, 0, 0, 1), 0, "rad=1 mrad=1e-3"),
    ("an angle", (0, 0, 0, 1), 1, "deg=1/180 °=1/180 rev=2"),
    ("a frequency", (0, 0, -1, 0), 0, "Hz=1 mHz=1e-3 kHz=1e3 MHz=1e6"),
    ("a force", (1, 1, -2, 0), 0, "N=1 mN=1e-3 kN=1e3"),
    ("a torque", (1, 2, -2, 0), 0, "Nm=1 mNm=1e-3 kNm=1e3"),
    ("a speed", (0, 1, -1, 0), 0, ""),
    ("an acceleration", (0, 1, -2, 0), 0, ""),
    ("an angular speed", (0, 0, -1, 1), 1, "rpm=1/30"),
    ("an angular acceleration", (0, 0, -2, 1), 0, ""),
)
_OTHER = {"s": "ms", "m": "cm", "kg": "g", "Hz": "kHz", "N": "kN"}  # for examples


class Unit(NamedTuple):
    """A unit: ``scale * pi**pi`` times the SI unit of its dimension."""

    scale: Fraction = Fraction(1)
    pi: int = 0
    dimension: tuple[int, ...] = (0, 0, 0, 0)

    def times(self, other: Unit, power: int) -> Unit:
        """Return the product with the other unit to a power."""
        powers = zip(self.dimension, other.dimension, strict=True)
        return Unit(
            self.scale * other.scale**power,
            self.pi + power * other.pi,
            tuple(a + power * b for a, b in powers),
        )


SYMBOLS = {
    symbol: Unit(Fraction(size), pi, dimension)
    for _, dimension, pi, symbols in _QUANTITIES
    for symbol, _, size in (text.partition("=") for text in symbols.split())
}
_NAMES: dict[tuple[int, ...], str] = {dimension: name for name, dimension, _, _ in _QUANTITIES}
_POWER = re.compile(r"\s*(?:\^|\*\*)\s*")
_GROUP = re.compile(r"\s*\(\s*(.*?)\s*\)\s*")
_TIMES = re.compile(r"\s*[*·×]\s*|\s+")
_FACTOR = re.compile(r"([A-Za-zµμ]+|°)(?:\^(-?[1-9]))?")


@lru_cache(maxsize=256)
def parse_unit(text: str) -> Unit:
    """Return the unit of a text: symbols, ``*`` or a space, ``^n``, ``/``; a denominator in parentheses.

    Raises UnitError for an unknown symbol, and for a product after ``/``, which is ambiguous.
    """
    powers = _POWER.sub("^", text.replace("²", "^2").replace("³", "^3"))
    first, *others = powers.split("/")
    parts = [(part, -1) for part in others]
    first = first.strip() or "1" * bool(others)  # "/s^2" after a number is 1/s^2
    unit = SYMBOLS["%"] if first == "%" else Unit()
    if first not in ("1", "%"):
        parts.insert(0, (first, 1))
    for part, sign in parts:
        group = _GROUP.fullmatch(part)
        factors = _TIMES.split(group[1] if group else part.strip())
        if sign < 0 and len(factors) > 1 and not group:
            raise UnitError(
                f"the unit {text!r} can be read in two ways: put the denominator in "
                "parentheses, as in N m/(rad s), and the numerator before the /"
            )
        for factor in factors:
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in SYMBOLS:
                raise UnitError(f"there is no unit {factor!r}")
            unit = unit.times(SYMBOLS[match[1]], sign * int(match[2] or 1))
    return unit


def read_quantity(text: str, *units: str) -> float:
    """Return a text's number in whichever of the units is of its dimension; empty: a ratio.

    The result is the double nearest to the exact one; degrees in radians are ``math.radians(number)``, to
    the bit. Raises UnitError: why the text is not allowed, and what is.
    """
    asked = [_declared(unit) for unit in units]
    try:
        if len(text) > _LONGEST:
            raise UnitError(f"it has {len(text)} characters: at most {_LONGEST} are read")
        match = QUANTITY.match(text)
        if match is None:
            raise UnitError("it is not a number, with or without a unit")
        sign, infinite, digits, exponent, written = match.groups()
        if exponent and abs(int(exponent)) > _LARGEST_EXPONENT:
            raise UnitError("it is beyond what a double can hold")
        unit = parse_unit(written.strip())
        for wanted in asked:
            if wanted.dimension == unit.dimension:
                number = math.inf if infinite else _converted(digits, unit, wanted)
                return -number if sign == "-" else number
        name = _NAMES.get(unit.dimension) or f"a quantity in {written.strip()}"
        raise UnitError(f"it is {name}")
    except UnitError as error:
        raise UnitError(f"{error}; {_needed(*units)}") from None


def _declared(unit: str) -> Unit:
    """Return the unit of a declaration; a controller from another package may have any."""
    try:
        return parse_unit(unit or "1")
    except UnitError:
        raise UnitError(f"trunk does not convert to {unit!r}: give a plain number") from None


def _converted(digits: str, unit: Unit, wanted: Unit) -> float:
    pi, scale = unit.pi - wanted.pi, unit.scale / wanted.scale
    try:
        if (pi, scale) == (1, Fraction(1, 180)):
            number = float(digits) * (math.pi / 180.0)  # as math.radians does it
        else:
            number = float(Fraction(digits) * scale * _PI**pi)
    except OverflowError:
        number = math.inf
    if math.isinf(number):
        raise UnitError("it is larger than any double")
    return number


def _needed(*units: str) -> str:
    """Return the allowed kind of value, with examples: ``a time in s is needed, such as 5 s or 5 ms``."""
    if not any(units):
        return "a plain number is needed, or a percentage such as 50%"
    kinds = [f"{_NAMES.get(parse_unit(unit).dimension, 'a quantity')} in {unit}" for unit in units]
    other = units[0].replace("rad", "deg") if "rad" in units[0] else _OTHER.get(units[0])
    examples = [f"5 {unit}".replace(" 1/", "/") for unit in (units[0], other) if unit]
    listed = " or ".join(filter(None, (", ".join(kinds[:-1]), kinds[-1])))
    return f"{listed} is needed, such as {' or '.join(examples)}"
