"""Records as compiled code takes them, made without the compiler."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")

_INTEGERS = {"pulse_starts", "table_times", "times", "turns_ns"}  # fields of ns


def with_arrays(record: Record) -> Record:
    """Return a named tuple with its tuples as arrays, so that its type does not include their lengths.

    Nested named tuples are treated likewise; anything else is returned unchanged.
    """
    if not hasattr(record, "_fields"):
        return record
    fields: Any = record
    made: Record = fields._make(
        np.array(value, dtype=np.int64 if name in _INTEGERS else np.float64)
        if type(value) is tuple
        else with_arrays(value)
        for name, value in zip(fields._fields, fields, strict=True)
    )
    return made
