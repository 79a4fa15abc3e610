"""A run's own record, read from well-formed little-endian CDR without a library.

rosbags compiles its code for these types anew in each process, which takes longer than reading a
ten-second recording. Anything not exactly as ROS 2 writes it gives None here and is left to rosbags.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

_HEAD = b"\x00\x01\x00\x00"  # CDR, little-endian, no options
_ODD = "not in the plain form that ROS 2 writes"
_STAMP, _COUNT = struct.Struct("<iI"), struct.Struct("<I")
_INTEGER, _DOUBLE = struct.Struct("<q"), struct.Struct("<d")


class Status(NamedTuple):
    """The one status of a DiagnosticArray."""

    sec: int
    nanosec: int
    level: int
    name: str
    message: str
    pairs: list[tuple[str, str]]
    frame: str


class Parameters(NamedTuple):
    """A ParameterEvent: name, type's number and the values of all fields of each parameter."""

    sec: int
    nanosec: int
    node: str
    new: list[tuple[str, int, tuple[Any, ...]]]
    changed: list[tuple[str, int, tuple[Any, ...]]]
    deleted: list[tuple[str, int, tuple[Any, ...]]]


class _RunCursor:
    """A place in a message; numbers are aligned to their size, counted from after the head."""

    def __init__(self, data: bytes) -> None:
        if data[:4] != _HEAD:
            raise ValueError(_ODD)
        self._data = data
        self._at = 4

    def number(self, kind: struct.Struct, size: int) -> Any:
        self._at += -(self._at - 4) % size
        found = kind.unpack_from(self._data, self._at)
        self._at += kind.size
        return found[0] if len(found) == 1 else found

    def byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1]

    def truth(self) -> bool:
        found = self.byte()
        if found > 1:
            raise ValueError(_ODD)
        return bool(found)

    def integer(self) -> int:
        return int(self.number(_INTEGER, 8))

    def double(self) -> float:
        return float(self.number(_DOUBLE, 8))

    def text(self) -> str:
        count = self.number(_COUNT, 4)
        end = self._at + count
        if not count or end > len(self._data) or self._data[end - 1]:
            raise ValueError(_ODD)
        found = self._data[self._at : end - 1].decode()
        self._at = end
        return found

    def several(self, one: Callable[[], Any]) -> list[Any]:
        count = self.number(_COUNT, 4)
        if count > len(self._data) - self._at:  # each takes a byte or more
            raise ValueError(_ODD)
        return [one() for _ in range(count)]

    def parameter(self) -> tuple[str, int, tuple[Any, ...]]:
        name, kind = self.text(), self.byte()
        scalars = (self.truth(), self.integer(), self.double(), self.text())
        ones = (self.byte, self.truth, self.integer, self.double, self.text)
        return name, kind, (*scalars, *(tuple(self.several(one)) for one in ones))

    def end(self) -> None:
        if self._at != len(self._data):
            raise ValueError(_ODD)


def diagnostic_array(data: bytes) -> Status | None:
    """Return the content of a DiagnosticArray with one status; None if rosbags has to judge it."""
    try:
        cursor = _RunCursor(data)
        sec, nanosec = cursor.number(_STAMP, 4)
        frame = cursor.text()
        if cursor.number(_COUNT, 4) != 1:
            return None
        level, name, message = cursor.byte(), cursor.text(), cursor.text()
        cursor.text()  # hardware_id
        pairs = cursor.several(lambda: (cursor.text(), cursor.text()))
        cursor.end()
    except (ValueError, struct.error, IndexError):
        return None
    return Status(sec, nanosec, level, name, message, pairs, frame)


def parameter_event(data: bytes) -> Parameters | None:
    """Return the content of a ParameterEvent; None if rosbags has to judge it."""
    try:
        cursor = _RunCursor(data)
        sec, nanosec = cursor.number(_STAMP, 4)
        node = cursor.text()
        new, changed, deleted = (cursor.several(cursor.parameter) for _ in range(3))
        cursor.end()
    except (ValueError, struct.error, IndexError):
        return None
    return Parameters(sec, nanosec, node, new, changed, deleted)
