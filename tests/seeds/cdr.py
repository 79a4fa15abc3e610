"""How long a message is on the wire.

rclpy's own ``serialize_message`` may return more than that: what follows the message has no meaning, and no
fixed bytes.
"""

from __future__ import annotations

import re
from typing import Any

_SIZES = {"boolean": 1, "octet": 1, "char": 1, "uint8": 1, "int8": 1, "uint16": 2, "int16": 2,
          "uint32": 4, "int32": 4, "float": 4, "uint64": 8, "int64": 8, "double": 8}  # fmt: skip
_ARRAY = re.compile(r"(.*)\[(\d+)\]")


def size(message: Any) -> int:
    """Return the length of a message in CDR, with the four bytes of encapsulation."""
    return 4 + _message(0, message)


def _message(at: int, message: Any) -> int:
    for name, kind in message.get_fields_and_field_types().items():
        at = _value(at, kind, getattr(message, name))
    return at


def _value(at: int, kind: str, value: Any) -> int:
    if kind.startswith("sequence<"):
        inner = kind[len("sequence<") : -1].partition(",")[0]
        at = _aligned(at, 4) + 4
        return _many(at, inner, value)
    if fixed := _ARRAY.fullmatch(kind):
        return _many(at, fixed[1], value)
    if kind.startswith("string"):
        return _aligned(at, 4) + 4 + len(value.encode()) + 1
    if kind in _SIZES:
        return _aligned(at, _SIZES[kind]) + _SIZES[kind]
    return _message(at, value)


def _many(at: int, kind: str, values: Any) -> int:
    if kind in _SIZES:
        return _aligned(at, _SIZES[kind]) + _SIZES[kind] * len(values) if len(values) else at
    for value in values:
        at = _value(at, kind, value)
    return at


def _aligned(at: int, to: int) -> int:
    return -(-at // to) * to
