"""`Messages`: the message records of a block, each with the header before its data; MCAP's headers."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trunk_core.arrays import Integers

# Bytes of a record and of an unpacked chunk, at most: no size that a file claims is trusted.
LIMIT = 128 << 20
MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # of every record: opcode, length of what follows
# What precedes a message's data: `HEAD`, then these four; one by one, and in bulk.
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
HEAD_FIELDS = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)


class MessageHead(NamedTuple):
    """What precedes a message's data, in this order; times in ns."""

    channel: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int


class Messages(NamedTuple):
    """Messages in the order of the file; message i is ``data[start[i]:end[i]]``."""

    data: bytes
    log_time_ns: Integers
    start: Integers
    end: Integers

    def heads(self) -> bytes:
        """Return the header of each message's data, with opcode and length, as it is in the file."""
        head = np.dtype((np.void, MESSAGE_HEAD.size))
        return unaligned(self.data, head)[self.offsets()].tobytes()

    def joined(self) -> bytes:
        """Return all messages, one after the other."""
        sizes = self.end - self.start
        size = int(sizes[0]) if len(sizes) else 0
        if not size or (sizes != size).any():
            return b"".join(self.bytes())
        return unaligned(self.data, f"V{size}")[self.start].tobytes()

    def bytes(self) -> list[bytes]:
        """Return each message."""
        data = self.data
        spans = zip(self.start.tolist(), self.end.tolist(), strict=True)
        return [data[start:end] for start, end in spans]

    def only(self, row: int) -> Messages:
        """Return one message alone."""
        rows = slice(row, row + 1)
        return Messages(self.data, self.log_time_ns[rows], self.start[rows], self.end[rows])

    def head(self, row: int) -> MessageHead:
        """Return the header of message ``row``."""
        at = int(self.start[row]) - MESSAGE_HEAD.size
        _, _, *head = MESSAGE_HEAD.unpack_from(self.data, at)
        return MessageHead._make(head)

    def channels(self) -> NDArray[Any]:
        """Return each message's channel [N]."""
        return head_field(self.data, self.offsets(), "channel")

    def offsets(self) -> Integers:
        """Return the first byte of each message's record [N]."""
        return self.start - MESSAGE_HEAD.size

    def __len__(self) -> int:
        return len(self.start)


def allowed(size: int) -> int:
    """Return how many bytes a file of ``size`` bytes may unpack to: far more than recordings do."""
    return max(LIMIT, 256 * size)


def data_starts(offsets: Integers) -> Integers:
    """Return the first byte of the data of the message records at ``offsets``."""
    return offsets + MESSAGE_HEAD.size


def head_field(data: bytes, offsets: Integers, name: str) -> NDArray[Any]:
    """Return one header field [N] of the message records at ``offsets``.

    ``name`` is channel, sequence, log_time or publish_time.
    """
    return unaligned(data, HEAD_FIELDS)[name][offsets]


def unaligned(data: bytes | NDArray[np.uint8], dtype: Any) -> NDArray[Any]:
    """Return a view in which element i is the value that begins at byte i."""
    dtype = np.dtype(dtype)
    return np.ndarray((max(len(data) - dtype.itemsize + 1, 0),), dtype, data, 0, (1,))
