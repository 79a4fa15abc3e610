"""XCDR1, little-endian: messages read and written by a table of their fields, each aligned to its size.

rosbags compiles its code for a type anew in each process, which takes longer than reading a ten-second
recording. What is not exactly as ROS 2 writes it is refused here, and left to rosbags.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from typing import Any, TypeAlias

CDR = b"\x00\x01"  # little-endian; two bytes of options follow
ORIGIN = 4  # alignment counts from here
MAX_NAME = 1024  # bytes of the name of a joint or a frame
_HEAD = CDR.ljust(ORIGIN, b"\x00")

# A type: the name of a number or "string", the fields of a structure, or a sequence of one type.
Type: TypeAlias = str | tuple["Type", ...] | list["Type"]

_CODES = {"bool": "B", "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "float64": "d"}
_NUMBERS = {name: struct.Struct(f"<{code}") for name, code in _CODES.items()}
_TIME: Type = ("int32", "uint32")
_STATUS: Type = ("uint8", "string", "string", "string", [("string", "string")])
_SCALARS = ("bool", "int64", "float64", "string")
_SEQUENCES: tuple[Type, ...] = tuple([element] for element in ("uint8", *_SCALARS))
_PARAMETER: Type = ("string", ("uint8", *_SCALARS, *_SEQUENCES))


class Codec:
    """Reads and writes the messages of a type: tuples stand for structures and sequences."""

    def __init__(self, kind: Type) -> None:
        self._kind = kind
        self._read = _reader(kind)

    def read(self, data: bytes) -> Any:
        """Return a message's content. Raises ValueError."""
        if data[:ORIGIN] != _HEAD:
            raise ValueError("not a little-endian CDR message")
        cursor = Cursor(data)
        content = self._read(cursor)
        if cursor.at != len(data):
            raise ValueError(f"{len(data) - cursor.at} bytes too many")
        return content

    def write(self, content: Any) -> bytes:
        """Return a message with this content; padding is zeros."""
        message = bytearray(_HEAD)
        _write(message, self._kind, content)
        return bytes(message)


def _write(message: bytearray, kind: Type, content: Any) -> None:
    if isinstance(kind, tuple):
        for field, value in zip(kind, content, strict=True):
            _write(message, field, value)
    elif isinstance(kind, list):
        _write(message, "uint32", len(content))
        for element in content:
            _write(message, kind[0], element)
    elif kind == "string":
        text = content.encode() + b"\x00"
        _write(message, "uint32", len(text))
        message += text
    else:
        number = _NUMBERS[kind]
        message += bytes((ORIGIN - len(message)) % number.size) + number.pack(content)


def _reader(kind: Type) -> Callable[[Cursor], Any]:
    """Return the function that reads a value of a type: made once, as a message has hundreds of values."""
    if isinstance(kind, tuple):
        fields = [_reader(field) for field in kind]
        return lambda cursor: tuple([read(cursor) for read in fields])
    if isinstance(kind, list):
        element = _reader(kind[0])
        return lambda cursor: cursor.sequence(element)
    if kind == "string":
        return Cursor.string
    if kind == "bool":
        return lambda cursor: cursor.byte(1) == 1
    if kind == "uint8":
        return Cursor.byte
    size, unpack = _NUMBERS[kind].size, _NUMBERS[kind].unpack
    return lambda cursor: unpack(cursor.take(size, size))[0]


class Cursor:
    """Reads a message's parts one after the other, never past its end. Its methods raise ValueError."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = ORIGIN

    def take(self, size: int, alignment: int) -> bytes:
        """Read some bytes."""
        start = self.at + (ORIGIN - self.at) % alignment
        self.at = end = start + size
        if end > len(self.data):
            raise ValueError(f"a message of {len(self.data)} bytes ends before byte {end}")
        return self.data[start:end]

    def byte(self, largest: int = 255) -> int:
        """Read a byte."""
        (value,) = self.take(1, 1)
        if value > largest:
            raise ValueError(f"a byte of {value}, at most {largest} is allowed")
        return value

    def count(self) -> int:
        """Read the length of a string or a sequence."""
        return int.from_bytes(self.take(4, 4), "little")

    def sequence(self, element: Callable[[Cursor], Any]) -> tuple[Any, ...]:
        """Read a sequence, each element by this function."""
        count = self.count()
        if not count:
            return ()
        if count > len(self.data) - self.at:  # each takes a byte or more
            raise ValueError(f"{count} elements in {len(self.data) - self.at} bytes")
        return tuple([element(self) for _ in range(count)])

    def string(self, longest: int = sys.maxsize) -> str:
        """Read a text of at most so many bytes."""
        data = self.take(self.count(), 1)
        if data[-1:] != b"\x00":
            raise ValueError("a string without its terminator")
        if len(data) > longest + 1:
            raise ValueError(f"a name of {len(data) - 1} bytes, at most {longest} are read")
        return data[:-1].decode()

    def names(self, limit: int) -> tuple[str, ...]:
        """Read a sequence of names, at most so many."""
        count = self.count()
        if count > limit:
            self.take(4 * count, 4)  # no more than can be there
            raise ValueError(f"{count} names, at most {limit} are read")
        return tuple(self.string(MAX_NAME) for _ in range(count))

    def doubles(self) -> int:
        """Read past a sequence of doubles, and return how many there are."""
        count = self.count()
        if count:  # an empty sequence is not aligned
            self.take(8 * count, 8)
        return count


DIAGNOSTIC_ARRAY = Codec(((_TIME, "string"), [_STATUS]))
PARAMETER_EVENT = Codec((_TIME, "string", [_PARAMETER], [_PARAMETER], [_PARAMETER]))
