"""Telling a number with a unit from other texts; `quantity` reads it, and is loaded only then."""

from __future__ import annotations

import re

from ..errors import TrunkError

# Sign, infinity or digits, the digits' exponent, unit.
QUANTITY = re.compile(
    r"\s*([-+]?)(?:\.?(inf)(?=\s)|((?:\d+\.?\d*|\.\d+)(?:[eE]([-+]?\d+))?)(?![\d.]))\s*(\S.*)",
    re.ASCII | re.DOTALL,
)


class UnitError(TrunkError):
    """A number with a unit that cannot be used: what is wrong, and what is allowed."""


def looks_like_quantity(text: str) -> bool:
    """Return True for a text that begins with a number and is not one by itself."""
    return QUANTITY.match(text) is not None and not _is_plain(text)


def _is_plain(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
