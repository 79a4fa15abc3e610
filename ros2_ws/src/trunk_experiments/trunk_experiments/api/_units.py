"""The units of columns and metrics."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ..analysis.metrics import QUANTITIES
from ..analysis.run_terms import DISTURBANCE
from ..analysis.run_terms import UNITS as OF_TERMS

_OF_COLUMNS = {
    "t": "s",
    "x": "m",
    "theta": "rad",
    "x_dot": "m/s",
    "theta_dot": "rad/s",
    "theta_measured": "rad",
    "reference": "rad",
    "torque": "N m",
    "kp": "N m/rad",
    "ki": "N m/(rad s)",
    "kd": "N m s/rad",
    "alpha": "",
}
COLUMNS = tuple(_OF_COLUMNS)  # of a run, in order

UNITS: Mapping[str, str] = MappingProxyType(
    {
        **_OF_COLUMNS,
        **OF_TERMS,
        **DISTURBANCE,
        **{name: quantity.unit for name, quantity in QUANTITIES.items()},
        "diverged_at_s": "s",
    }
)
