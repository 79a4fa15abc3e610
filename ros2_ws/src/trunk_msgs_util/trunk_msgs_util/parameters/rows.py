"""Parameters that are the rows of a table over time: how times are declared, and what holds for rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .declarations import ParameterError, parameter

MOST_ROWS = 10_000


def times_parameter(name: str, description: str) -> Any:
    """Return the declaration of times in s, by default none."""
    return parameter(
        name,
        (),
        description,
        unit="s",
        element=float,
        longest=MOST_ROWS,
        minimum=0.0,
        maximum=1e6,
    )


def check_rows(prefix: str, times: Sequence[float], values: Sequence[float]) -> None:
    """Raise ParameterError unless ``PREFIX.values`` are as many as ``PREFIX.times``, which ascend."""
    if len(values) != len(times):
        raise ParameterError(
            f"{prefix}.values", values, f"as many as {prefix}.times ({len(times)})"
        )
    if list(times) != sorted(times):
        raise ParameterError(f"{prefix}.times", times, "ascending times")
