"""Limits on what is read of a file: far above any robot's recording; a hostile file meets them early.

The sizes that a file claims are never trusted: with these limits, the time and the memory that a file
costs are bounded by the bytes it has. docs/recording.md lists them; every error names the one it met.
"""

from __future__ import annotations

MAX_CHUNK = 128 << 20  # bytes of an unpacked chunk, and of a record outside chunks
MAX_CHANNELS = 4096  # channels of a file, and its schemas; topics of a bag
MAX_NAME = 1024  # bytes of the name of a topic, a type, a joint or a frame
MAX_JOINTS = 1024  # names in a JointState message, and in all messages of a topic together
MAX_LAYOUTS = 256  # layouts (frame, names, numbers of values) of a JointState topic
MAX_TEXT = 16 << 20  # bytes of all messages of run/parameters, and of run/events
MAX_METADATA = 1 << 20  # bytes of all our metadata records in a file
MAX_BAG_METADATA = 1 << 20  # characters of a bag's metadata.yaml

# A table of N messages by M names may have this many values, and this many times those in the messages.
_FREE_VALUES, _TIMES_VALUES = 1 << 21, 16
# All chunks of a file may unpack to this many bytes, and this many times its size.
_FREE_BYTES, _TIMES_SIZE = 256 << 20, 256
# A file may have this many records, and one more for every `_BYTES_A_RECORD` of its bytes. With an index,
# each message takes more.
_FREE_RECORDS, _BYTES_A_RECORD = 1 << 18, 8


class LimitError(ValueError):
    """A file goes beyond a limit, which the message names."""


def check_table(messages: int, names: int, size: int) -> None:
    """Raise LimitError if messages of ``size`` bytes would make too large a table of their joints."""
    if messages * names > max(_FREE_VALUES, _TIMES_VALUES * (size // 8)):
        raise LimitError(
            f"a table of {messages} messages by {names} names has more than the "
            f"{max(_FREE_VALUES, _TIMES_VALUES * (size // 8))} values that are read"
        )


class Budget:
    """What may still be read of a file of ``size`` bytes."""

    def __init__(self, size: int) -> None:
        self.max_bytes = max(_FREE_BYTES, _TIMES_SIZE * size)
        self.max_records = _FREE_RECORDS + size // _BYTES_A_RECORD
        self._bytes = self._records = 0

    def unpack(self, size: int) -> None:
        """Take account of a chunk before it is unpacked. Raises LimitError."""
        self._bytes += size
        if self._bytes > self.max_bytes:
            raise LimitError(f"its chunks unpack to more than the {self.max_bytes} bytes allowed")

    def take(self, records: int) -> None:
        """Take account of some records. Raises LimitError."""
        self._records += records
        if self._records > self.max_records:
            raise LimitError(f"it has more than the {self.max_records} records allowed")
