"""A number with a unit, as text: ``45 deg``, ``100ms``, ``9.6N*m/rad``, in the unit that is asked for."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

from .quantity_text import QUANTITY, UnitError
from .unit_symbols import Unit, named, named_in, parse_unit

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
                found = float(self.digits) * (math.pi / 180.0)  # as math.radians does it
            else:
                found = float(Fraction(self.digits) * scale * _PI**pi)
        except OverflowError:
            found = math.inf
        if math.isinf(found):
            raise UnitError("it is larger than any double")
        return self.sign * found


def parse_quantity(text: str) -> Quantity:
    """Return a number with its unit. Raises UnitError."""
    if len(text) > _LONGEST:
        raise UnitError(f"it has {len(text)} characters: at most {_LONGEST} are read")
    found = QUANTITY.match(text)
    if found is None:
        raise UnitError("it is not a number, with or without a unit")
    sign, infinite, digits, exponent, unit = found.groups()
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
        found = parse_quantity(text)
    except UnitError as error:
        raise UnitError(f"{error}; {needed(*units)}") from None
    for unit in asked:
        if unit.dimension == found.unit.dimension:
            return found.within(unit)
    raise UnitError(f"it is {named(found.written)}; {needed(*units)}")


def _declared(unit: str) -> Unit:
    """Return the unit of a declaration; a controller from another package may have any."""
    try:
        return parse_unit(unit or "1")
    except UnitError:
        raise UnitError(f"trunk does not convert to {unit!r}: give a plain number") from None


def needed(*units: str) -> str:
    """Return what is allowed, with examples: ``a time in s is needed, such as 5 s or 5 ms``."""
    if not any(units):
        return "a plain number is needed, or a percentage such as 50%"
    names = [named_in(unit) for unit in units]
    told = " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    return f"{told} is needed, such as {' or '.join(_examples(units[0]))}"


def _examples(unit: str) -> tuple[str, ...]:
    """Return a value in the unit and, for a short unit or an angle, one in another."""
    other = unit.replace("rad", "deg") if "rad" in unit else _OTHER.get(unit)
    return tuple(
        f"5{one.removeprefix('1')}" if one.startswith("1/") else f"5 {one}"
        for one in (unit, other)
        if one
    )
