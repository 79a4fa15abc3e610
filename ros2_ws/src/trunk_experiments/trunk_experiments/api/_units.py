"""The units of columns and metrics."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ..analysis.metrics import QUANTITIES
from ..analysis.run_table import DISTURBANCE, TABLE_UNITS
from ..analysis.run_table import UNITS as OF_TERMS

COLUMNS = tuple(TABLE_UNITS)  # of a run, in order

UNITS: Mapping[str, str] = MappingProxyType(
    {
        **TABLE_UNITS,
        **OF_TERMS,
        **DISTURBANCE,
        **{name: quantity.unit for name, quantity in QUANTITIES.items()},
        "diverged_at_s": "s",
    }
)
