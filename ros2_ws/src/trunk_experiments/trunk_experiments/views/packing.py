"""A page's columns as compact text: exact to the last bit, or in steps that are too fine to see.

A column becomes integers: its doubles' bits, or its values in steps. Differences of up to third order are
small where a curve is smooth; their bytes, all lowest ones first, are deflated and written as
base64. `report_assets/data.js` undoes this. A smooth curve has half the size that its doubles have as base64,
and a tenth or less where 24 bits of its range are enough.
"""

from __future__ import annotations

import base64
import hashlib
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from trunk_msgs_util.recording.joint_table import Floats, Integers

_MOST_DIFFERENCES = 3
_RANGE_BITS = 30  # of all steps: they and the mark of a gap fit into 32-bit integers
_USUAL = 0.985  # of the values: short peaks do not make all others coarse
_JUDGED = 100_000  # differences by which the order is chosen
_GAP = -1  # instead of a number of steps: NaN

Columns = dict[str, dict[str, Any]]


def packed(values: Floats, bits: int | None = None) -> dict[str, Any]:
    """Return an array of doubles as plain values for JSON, ready for the page.

    ``bits`` None: every value, NaN included, comes back with the same bits. Otherwise it comes back as the
    nearest of evenly spaced values, 2**bits of them over the usual range; the least and the greatest come
    back exactly. A constant column is always exact, and so is one with infinite values.
    """
    data = np.ascontiguousarray(values, "<f8")
    whole = data.view("<i8")
    if len(data) and (whole == whole[0]).all() and np.isfinite(data[0]):
        return {"constant": float(data[0]), "count": len(data)}
    rounded = None if bits is None else _in_steps(data, bits)
    if rounded is None:
        return _differences(whole)
    steps, scale = rounded
    return _differences(steps) | scale


def packed_columns(columns: Mapping[str, Floats], bits: int | None = None) -> Columns:
    """Return columns by name; a column of the same bits as an earlier one only names it.

    The times ``t`` are always exact, so that a stamp can be found.
    """
    result: Columns = {}
    seen: dict[bytes, str] = {}
    for name, values in columns.items():
        data = np.ascontiguousarray(values, "<f8")
        earlier = seen.setdefault(hashlib.blake2b(data.data).digest(), name)
        if earlier == name:
            result[name] = packed(values, None if name == "t" else bits)
        else:
            result[name] = {"same": earlier}
    return result


def _in_steps(data: Floats, bits: int) -> tuple[Integers, dict[str, float]] | None:
    """Return the values as numbers of steps, and what converts them back.

    None: they have no finite range.
    """
    gaps = np.isnan(data)
    known = data[~gaps] if gaps.any() else data
    if not len(known) or not np.isfinite(known).all():
        return None
    low, high = float(known.min()), float(known.max())
    middle = float(np.median(known))
    usual = 2.0 * float(np.quantile(np.abs(known - middle), _USUAL))
    step = max((usual or high - low) * 2.0**-bits, (high - low) * 2.0**-_RANGE_BITS)
    if not (0.0 < step < np.inf and np.isfinite((high - low) / step)):
        return None
    steps = np.rint((np.where(gaps, low, data) - low) / step).astype("<i4")
    steps[gaps] = _GAP
    return steps, {"low": low, "high": high, "step": step}


def _differences(whole: Integers) -> dict[str, Any]:
    """Return 32- or 64-bit integers as the differences that take the fewest bits; sums wrap around."""
    tried = [whole]
    for _ in range(_MOST_DIFFERENCES):
        tried.append(np.diff(tried[-1], prepend=whole.dtype.type(0)).astype(whole.dtype))
    few = slice(None, None, 1 + len(whole) // _JUDGED)
    sizes = [float(np.log2(1.0 + np.abs(d[few].astype(np.float64))).sum()) for d in tried]
    order = int(np.argmin(sizes))
    planes = tried[order].view(np.uint8).reshape(-1, whole.itemsize).T
    deflater = zlib.compressobj(6, zlib.DEFLATED, -zlib.MAX_WBITS)
    data = deflater.compress(np.ascontiguousarray(planes).tobytes()) + deflater.flush()
    return {
        "packed": base64.b64encode(data).decode("ascii"),
        "count": len(whole),
        "differences": order,
    }
