"""MCAP written byte by byte, so that a file may say what no library would write."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import zstandard

MAGIC = b"\x89MCAP0\r\n"
JOINT_STATE = "sensor_msgs/msg/JointState"
EVENTS = "diagnostic_msgs/msg/DiagnosticArray"
PARAMETERS = "rcl_interfaces/msg/ParameterEvent"


def record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    """Return a record; ``length``: what it claims."""
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def text(value: str | bytes) -> bytes:
    """Return a string of MCAP."""
    data = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(data)) + data


def mapping(values: Mapping[str, str]) -> bytes:
    """Return a map of strings of MCAP."""
    body = b"".join(text(key) + text(value) for key, value in values.items())
    return struct.pack("<I", len(body)) + body


def header(library: str = "foreign") -> bytes:
    """Return the header record."""
    return record(1, text("ros2") + text(library))


def schema(number: int, name: str, data: bytes = b"") -> bytes:
    """Return a schema record."""
    body = struct.pack("<H", number) + text(name) + text("ros2msg")
    return record(3, body + struct.pack("<I", len(data)) + data)


def channel(number: int, topic: str | bytes, schema_number: int = 1) -> bytes:
    """Return a channel record."""
    return record(
        4, struct.pack("<HH", number, schema_number) + text(topic) + text("cdr") + mapping({})
    )


def message(number: int, log_ns: int, data: bytes, sequence: int = 0) -> bytes:
    """Return a message record."""
    return record(5, struct.pack("<HIQQ", number, sequence, log_ns, log_ns) + data)


def metadata(name: str, values: Mapping[str, str]) -> bytes:
    """Return a metadata record."""
    return record(12, text(name) + mapping(values))


def chunk(
    data: bytes, *, size: int | None = None, compression: str = "zstd", packed: bytes | None = None
) -> bytes:
    """Return a chunk record of some records; ``packed``: what it holds instead."""
    if packed is None:
        packed = zstandard.compress(data) if compression == "zstd" else data
    head = struct.pack("<QQQI", 0, 0, len(data) if size is None else size, 0)
    return record(6, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


def footer(start: int = 0, summary: bytes = b"") -> bytes:
    """Return the footer record of a summary that begins at ``start``."""
    head = struct.pack("<BQQQ", 2, 20, start, 0)
    return head + struct.pack("<I", zlib.crc32(head, zlib.crc32(summary)))


def write(path: Path, parts: Iterable[bytes], *, library: str = "foreign") -> Path:
    """Write a file without a summary, whose data are these records."""
    with path.open("wb") as file:
        file.write(MAGIC + header(library))
        for part in parts:
            file.write(part)
        file.write(record(15, bytes(4)) + footer() + MAGIC)
    return path


def stamp(ns: int) -> bytes:
    """Return a stamp of CDR."""
    return struct.pack("<iI", *divmod(ns, 1_000_000_000))


class Cdr:
    """A little-endian CDR message, field by field."""

    def __init__(self) -> None:
        self.data = bytearray(b"\0\1\0\0")

    def align(self, size: int) -> None:
        """Pad to a multiple of ``size``."""
        self.data += bytes(-(len(self.data) - 4) % size)

    def uint(self, value: int) -> Cdr:
        """Add a uint32."""
        self.align(4)
        self.data += struct.pack("<I", value)
        return self

    def string(self, value: str | bytes) -> Cdr:
        """Add a string."""
        octets = value.encode() if isinstance(value, str) else value
        self.uint(len(octets) + 1)
        self.data += octets + b"\0"
        return self

    def doubles(self, values: Sequence[float]) -> Cdr:
        """Add a sequence of doubles."""
        self.uint(len(values))
        if values:
            self.align(8)
            self.data += struct.pack(f"<{len(values)}d", *values)
        return self

    def stamp(self, ns: int) -> Cdr:
        """Add a stamp."""
        self.align(4)
        self.data += stamp(ns)
        return self


def joint_state(
    ns: int,
    names: Sequence[str | bytes],
    position: Sequence[float] = (),
    velocity: Sequence[float] = (),
    effort: Sequence[float] = (),
    frame: str = "",
) -> bytes:
    """Return a JointState message."""
    cdr = Cdr().stamp(ns).string(frame).uint(len(names))
    for name in names:
        cdr.string(name)
    for values in (position, velocity, effort):
        cdr.doubles(values)
    return bytes(cdr.data)
