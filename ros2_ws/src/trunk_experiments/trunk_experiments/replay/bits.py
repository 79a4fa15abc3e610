"""Doubles compared bit by bit, and how far apart they are."""

from __future__ import annotations

import struct
from math import copysign


def _ordered(value: float) -> int:
    """Return the double's bits as an integer that increases with the value."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return int(bits) if bits >= 0 else -(bits & 0x7FFF_FFFF_FFFF_FFFF)


def same(a: float, b: float) -> bool:
    """Return True where both have the same 64 bits (so NaN equals itself, and 0.0 differs from -0.0)."""
    return struct.pack("<d", a) == struct.pack("<d", b)


def ulps(a: float, b: float) -> int | None:
    """Return the distance from ``a`` to ``b`` in doubles; None where one is NaN.

    0.0 and -0.0 are 0 apart, though their bits differ.
    """
    if a != a or b != b:
        return None
    return abs(_ordered(a) - _ordered(b))


def alike(a: float, b: float) -> bool:
    """Return True if both have the same bits: `same`, but never for NaN. Compiles unchanged."""
    return a == b and (a != 0.0 or copysign(1.0, a) == copysign(1.0, b))
