"""A number with a unit, as text: ``45 deg``, ``100ms``, ``9.6N*m/rad``, in the unit that is asked for.

Units are written out, such as ``N m/(rad s)``. The angle counts as a quantity of its own. A torque (N m)
is thus not a gain (N m/rad), and a frequency (Hz) not an angular speed (rad/s): between those a factor of
2 pi is easily lost.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from difflib import get_close_matches
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
_OTHER = {"s": "ms", "m": "cm", "kg": "g", "Hz": "kHz", "N": "kN"}  # for examples


class Quantity(NamedTuple):
    """A number, exactly as written, and its unit."""

    sign: int
    digits: str  # without the sign; "inf"
    unit: Unit
    written: str  # the unit

    def within(self, unit: Unit) -> float:
        """Return the number of these units, as the double nearest to the exact result.

        Degrees in radians are ``math.radians(number)``, to the bit: what Python and NumPy give.
        Raises UnitError for a number that is too large for a double.
        """
        if self.digits == "inf":
            return self.sign * math.inf
        pi = self.unit.pi - unit.pi
        scale = self.unit.scale / unit.scale
        try:
            if pi == 1 and scale == Fraction(1, 180):
                number = float(self.digits) * (math.pi / 180.0)  # as math.radians does it
            else:
                number = float(Fraction(self.digits) * scale * _PI**pi)
        except OverflowError:
            number = math.inf
        if math.isinf(number):
            raise UnitError("it is larger than any double")
        return self.sign * number


def parse_quantity(text: str) -> Quantity:
    """Return a number with its unit. Raises UnitError."""
    if len(text) > _LONGEST:
        raise UnitError(f"it has {len(text)} characters: at most {_LONGEST} are read")
    match = QUANTITY.match(text)
    if match is None:
        raise UnitError("it is not a number, with or without a unit")
    sign, infinite, digits, exponent, unit = match.groups()
    if exponent and abs(int(exponent)) > _LARGEST_EXPONENT:
        raise UnitError("it is beyond what a double can hold")
    unit = unit.strip()
    return Quantity(-1 if sign == "-" else 1, infinite or digits, parse_unit(unit), unit)


def read_quantity(text: str, *units: str) -> float:
    """Return a text's number in whichever of the units is of its dimension; empty: a ratio.

    Raises UnitError: why the text is not allowed, and what is.
    """
    asked = [_declared(unit) for unit in units]
    try:
        quantity = parse_quantity(text)
    except UnitError as error:
        raise UnitError(f"{error}; {needed(*units)}") from None
    for unit in asked:
        if unit.dimension == quantity.unit.dimension:
            return quantity.within(unit)
    raise UnitError(f"it is {named(quantity.written)}; {needed(*units)}")


def _declared(unit: str) -> Unit:
    """Return the unit of a declaration; a controller from another package may have any."""
    try:
        return parse_unit(unit or "1")
    except UnitError:
        raise UnitError(f"trunk does not convert to {unit!r}: give a plain number") from None


def needed(*units: str) -> str:
    """Return the allowed kind of value, with examples: ``a time in s is needed, such as 5 s or 5 ms``."""
    if not any(units):
        return "a plain number is needed, or a percentage such as 50%"
    names = [named_in(unit) for unit in units]
    kinds = " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    return f"{kinds} is needed, such as {' or '.join(_examples(units[0]))}"


def _examples(unit: str) -> tuple[str, ...]:
    """Return a value in the unit and, for a short unit or an angle, one in another."""
    other = unit.replace("rad", "deg") if "rad" in unit else _OTHER.get(unit)
    return tuple(
        f"5{symbol.removeprefix('1')}" if symbol.startswith("1/") else f"5 {symbol}"
        for symbol in (unit, other)
        if symbol
    )


_LONGEST_UNIT = 60  # characters of a unit
_TOKEN = re.compile(r"\s*(?:([A-Za-zµμ]+|[°%])|(\*\*|\^)\s*(-?\d+)|([²³])|([1*·×/()])|(\S))")
_SUPERSCRIPTS = {"²": 2, "³": 3}
_LARGEST_POWER = 9


class Dimension(NamedTuple):
    """The powers of mass, length, time and angle."""

    mass: int = 0
    length: int = 0
    time: int = 0
    angle: int = 0


class Unit(NamedTuple):
    """A unit: ``scale * pi**pi`` times the SI unit of its dimension."""

    scale: Fraction = Fraction(1)
    pi: int = 0
    dimension: Dimension = Dimension()

    def times(self, other: Unit, power: int = 1) -> Unit:
        """Return the product with the other unit to a power."""
        return Unit(
            self.scale * other.scale**power,
            self.pi + power * other.pi,
            Dimension(
                *(a + power * b for a, b in zip(self.dimension, other.dimension, strict=True))
            ),
        )


_MASS, _LENGTH, _TIME, _ANGLE = (
    Dimension(1),
    Dimension(0, 1),
    Dimension(0, 0, 1),
    Dimension(angle=1),
)
_FREQUENCY, _FORCE, _TORQUE = Dimension(time=-1), Dimension(1, 1, -2), Dimension(1, 2, -2)
_PREFIXES = {
    "n": Fraction(1, 10**9),
    "u": Fraction(1, 10**6),
    "µ": Fraction(1, 10**6),
    "μ": Fraction(1, 10**6),
    "m": Fraction(1, 10**3),
    "c": Fraction(1, 10**2),
    "k": Fraction(10**3),
    "M": Fraction(10**6),
}
_WITH_PREFIXES = (  # the symbol, its dimension, its size in SI units, the prefixes that it may have
    ("s", _TIME, Fraction(1), "nuµμm"),
    ("m", _LENGTH, Fraction(1), "uµμmck"),
    ("g", _MASS, Fraction(1, 1000), "mk"),
    ("rad", _ANGLE, Fraction(1), "m"),
    ("Hz", _FREQUENCY, Fraction(1), "mkM"),
    ("N", _FORCE, Fraction(1), "mk"),
    ("Nm", _TORQUE, Fraction(1), "mk"),
)
SYMBOLS: dict[str, Unit] = {
    "%": Unit(Fraction(1, 100)),
    "min": Unit(Fraction(60), 0, _TIME),
    "h": Unit(Fraction(3600), 0, _TIME),
    "deg": Unit(Fraction(1, 180), 1, _ANGLE),
    "°": Unit(Fraction(1, 180), 1, _ANGLE),
    "rev": Unit(Fraction(2), 1, _ANGLE),
    "rpm": Unit(Fraction(2, 60), 1, Dimension(time=-1, angle=1)),
    **{
        prefix + symbol: Unit(size * _PREFIXES.get(prefix, Fraction(1)), 0, dimension)
        for symbol, dimension, size, prefixes in _WITH_PREFIXES
        for prefix in ("", *prefixes)
    },
}
# What people write in place of a symbol; only for "did you mean".
_WORDS = {
    "sec": "s", "second": "s", "msec": "ms", "minute": "min", "hour": "h", "hr": "h",
    "metre": "m", "meter": "m", "gram": "g", "kilogram": "kg", "kilo": "kg",
    "degree": "deg", "radian": "rad", "turn": "rev", "revolution": "rev",
    "newton": "N", "hertz": "Hz", "cps": "Hz", "percent": "%",
}  # fmt: skip
_NAMES = {
    Dimension(): "a ratio",
    _MASS: "a mass",
    _LENGTH: "a length",
    _TIME: "a time",
    _ANGLE: "an angle",
    _FREQUENCY: "a frequency",
    _FORCE: "a force",
    _TORQUE: "a torque",
    Dimension(length=1, time=-1): "a speed",
    Dimension(length=1, time=-2): "an acceleration",
    Dimension(time=-1, angle=1): "an angular speed",
    Dimension(time=-2, angle=1): "an angular acceleration",
}


def named(unit: str) -> str:
    """Return the quantity in a unit: ``a time``, or ``a quantity in N m/rad``. Raises UnitError."""
    return _NAMES.get(parse_unit(unit).dimension) or f"a quantity in {unit}"


def named_in(unit: str) -> str:
    """Return the quantity that a unit measures, and the unit: ``a time in s``. Raises UnitError."""
    return f"{_NAMES.get(parse_unit(unit).dimension, 'a quantity')} in {unit}"


@lru_cache(maxsize=256)
def parse_unit(text: str) -> Unit:
    """Return the unit that a text stands for: symbols, ``*`` or a space, ``/``, ``^n``, parentheses.

    Raises UnitError for an unknown symbol, and for a product after ``/``, which is ambiguous.
    """
    if len(text) > _LONGEST_UNIT:
        raise UnitError(f"its unit has {len(text)} characters: at most {_LONGEST_UNIT} are read")
    return _Parser(text).whole()


class _Parser:
    """Recursive descent over the tokens of one unit."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = list(self._tokens(text))

    def _tokens(self, text: str) -> Iterator[str | int]:
        """Yield symbols and signs as text, powers as integers."""
        for symbol, _, power, superscript, sign, strange in _TOKEN.findall(text):
            if strange:
                raise UnitError(f"{strange!r} in the unit {text!r} cannot be read")
            if power or superscript:
                yield int(power[:3]) if power else _SUPERSCRIPTS[superscript]
            else:
                yield symbol or sign

    def whole(self) -> Unit:
        unit = Unit()
        # Only in front, alone or divided: in 5 m1 or 50%% a sign is too many.
        if first := self.tokens[1:2] in ([], ["/"]) and self.is_at("1", "%"):
            unit = SYMBOLS["%"] if self.tokens.pop(0) == "%" else unit
        if self.tokens or not first:
            unit = unit.times(self.product())
        if self.tokens:
            raise self.misplaced(self.tokens[0])
        return unit

    def product(self) -> Unit:
        # "/s^2" after a number is 1/s^2.
        unit = Unit() if self.is_at("/") else self.factor()
        divided = False
        while self.tokens and not self.is_at(")"):
            sign = self.tokens.pop(0) if self.is_at("/", "*", "·", "×") else "*"
            divided = divided or sign == "/"
            if divided and sign != "/":
                raise UnitError(
                    f"the unit {self.text!r} can be read in two ways: put the denominator in "
                    "parentheses, as in N m/(rad s), and the numerator before the /"
                )
            unit = unit.times(self.factor(), -1 if sign == "/" else 1)
        return unit

    def factor(self) -> Unit:
        if not self.tokens:
            raise UnitError(f"the unit {self.text!r} is not complete")
        token = self.tokens.pop(0)
        if token == "(":
            unit = self.product()
            if not self.is_at(")"):
                raise UnitError(f"the unit {self.text!r} lacks a )")
            self.tokens.pop(0)
            return unit
        if isinstance(token, int) or not (token.isalpha() or token == "°"):
            raise self.misplaced(token)
        if token not in SYMBOLS:
            raise UnitError(f"there is no unit {token!r}{_meant(token)}")
        power = self.tokens.pop(0) if self.tokens and isinstance(self.tokens[0], int) else 1
        if not isinstance(power, int) or abs(power) > _LARGEST_POWER:
            raise UnitError(
                f"the power {power} in the unit {self.text!r}: {_LARGEST_POWER} at most"
            )
        return Unit().times(SYMBOLS[token], power)

    def is_at(self, *signs: str) -> bool:
        return bool(self.tokens) and self.tokens[0] in signs

    def misplaced(self, token: str | int) -> UnitError:
        sign = f"a power of {token}" if isinstance(token, int) else repr(token)
        return UnitError(f"{sign} is misplaced in the unit {self.text!r}")


def _meant(symbol: str) -> str:
    """Return ``(did you mean 's'?)``, or nothing where no known unit is like it."""
    word = symbol.lower()
    singular = word.removesuffix("s") or word
    by_lower = {known.lower(): known for known in reversed(SYMBOLS)} | _WORDS
    close = by_lower.get(word) or by_lower.get(singular)
    if close is None:
        matches = get_close_matches(singular, by_lower, n=1, cutoff=0.75)
        close = by_lower[matches[0]] if matches else None
    return f" (did you mean {close!r}?)" if close else ""
