"""`RecordingWriter`: writes one run into one MCAP file, as ROS 2's tools would.

The library takes ten microseconds for a message, most of what recording costs. Here a message is packed
once; checksums and index are made chunk by chunk. All other records are the library's own.
"""

from __future__ import annotations

import errno
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import LIBRARY_IDENTIFIER

from . import rosbag2
from .digests import DIGESTS, END, PROVENANCE, RunningDigests
from .interleaved import Interleaved, Rows, interleaved
from .messages import HEAD, MAGIC, MESSAGE_HEAD
from .own_file import check_own, open_own
from .schemas import definition

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import TracebackType

__all__ = ["END", "PROVENANCE", "RecordingWriter"]

PROFILE, _LIBRARY = "ros2", f"trunk_msgs_util {LIBRARY_IDENTIFIER}"
_COMPRESSIONS = {"zstd": "zstd", "lz4": "lz4", "none": ""}
CHUNK_SIZE = 1 << 20
COMPRESSIONS: dict[str, Callable[[bytes], bytes]] = {
    "zstd": zstandard.compress,
    "lz4": lz4.frame.compress,
    "": bytes,
}
_ENTRY = struct.Struct("<QQ")  # of a message index: log time, offset in the chunk

# Takes a chunk's message heads, and its messages by channel.
Taken = Callable[[bytes, dict[int, bytes]], None]


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    made: bytes = builder.end()
    return made


class ChunkedWriter:
    """Writes header, chunks with their indexes, metadata, and a summary; all checksums are on.

    Byte for byte what ``mcap.writer.Writer`` makes of the same calls.
    """

    def __init__(self, stream: BinaryIO, compression: str, taken: Taken) -> None:
        """Write to ``stream``; ``compression`` is a key of `COMPRESSIONS`."""
        self._stream = stream
        self._compression = compression
        self._taken = taken
        self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.counts: dict[int, int] = {}  # of messages, per channel
        self.first_ns: int | None = None  # log times, of the chunks that are written
        self.last_ns = 0
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._records: list[bytes] = []
        self._size = 0
        self._heads: list[bytes] = []
        self._messages: dict[int, list[bytes]] = {}
        self._index: dict[int, bytearray] = {}  # entries per channel
        self._start_ns: int | None = None
        self._end_ns = 0

    def _write(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)

    def start(self, profile: str, library: str) -> None:
        """Write the file's header."""
        self._write(MAGIC + _record(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema and return its number."""
        self._schemas.append(Schema(len(self._schemas) + 1, data, encoding, name))
        self._add(_record(self._schemas[-1]))
        return len(self._schemas)

    def register_channel(
        self, topic: str, encoding: str, schema: int, metadata: dict[str, str]
    ) -> int:
        """Add a channel and return its number."""
        number = len(self._channels) + 1
        self._channels.append(Channel(number, topic, encoding, metadata, schema))
        self._add(_record(self._channels[-1]))
        return number

    def _add(self, record: bytes) -> None:
        self._records.append(record)
        self._size += len(record)
        if self._size > CHUNK_SIZE:
            self._finish_chunk()

    def add_message(
        self, channel: int, log_time_ns: int, data: bytes, publish_time_ns: int
    ) -> None:
        """Add a message; sequence numbers count each channel's from 0."""
        sequence = self.counts.get(channel, 0)
        length = MESSAGE_HEAD.size - HEAD.size + len(data)
        head = MESSAGE_HEAD.pack(
            Opcode.MESSAGE, length, channel, sequence, log_time_ns, publish_time_ns
        )
        self.counts[channel] = sequence + 1
        if channel not in self._index:
            self._index[channel], self._messages[channel] = bytearray(), []
        self._index[channel] += _ENTRY.pack(log_time_ns, self._size)
        self._messages[channel].append(data)
        self._heads.append(head)
        self._records += (head, data)
        self._size += MESSAGE_HEAD.size + len(data)
        if self._start_ns is None or log_time_ns < self._start_ns:
            self._start_ns = log_time_ns
        if log_time_ns > self._end_ns:
            self._end_ns = log_time_ns
        if self._size > CHUNK_SIZE:
            self._finish_chunk()

    def add_rows(self, rows: Sequence[Rows]) -> None:
        """Add messages of several channels in the order of their place, as calls of `add_message` would."""
        rows = [part for part in rows if len(part.place)]
        if not rows:
            return
        many = interleaved(rows, self.counts)
        first, last = 0, len(many.end)
        while first < last:
            # Up to the record with which the chunk becomes too large, as in `add_message`.
            full = int(many.start[first]) + CHUNK_SIZE - self._size
            fits = int(np.searchsorted(many.end, full, side="right"))
            stop = min(max(fits, first) + 1, last)
            self._add_records(many, first, stop)
            if self._size > CHUNK_SIZE:
                self._finish_chunk()
            first = stop

    def _add_records(self, many: Interleaved, first: int, last: int) -> None:
        channels, times = many.channel[first:last], many.time_ns[first:last]
        offsets = many.start[first:last] - many.start[first] + self._size
        entries = np.stack([times, offsets], axis=1).astype("<u8")
        numbers, earliest = np.unique(channels, return_index=True)
        for number in numbers[np.argsort(earliest)].tolist():
            places = np.flatnonzero(channels == number)
            if number not in self._index:
                self._index[number], self._messages[number] = bytearray(), []
            self._index[number] += entries[places].tobytes()
            self._messages[number].append(many.messages(first + places))
        self._heads.append(many.heads(first, last))
        self._records.append(many.records(first, last))
        self._size += len(self._records[-1])
        least = int(times.min())
        self._start_ns = least if self._start_ns is None else min(least, self._start_ns)
        self._end_ns = max(int(times.max()), self._end_ns)

    def _finish_chunk(self) -> None:
        if self._start_ns is None:  # no message: other records wait for the next chunk
            return
        heads, start_ns, end_ns = b"".join(self._heads), self._start_ns, self._end_ns
        messages = {channel: b"".join(pieces) for channel, pieces in self._messages.items()}
        records, index = b"".join(self._records), self._index
        self._begin_chunk()
        self.first_ns = start_ns if self.first_ns is None else min(start_ns, self.first_ns)
        self.last_ns = max(end_ns, self.last_ns)
        self._taken(heads, messages)
        data = COMPRESSIONS[self._compression](records)
        chunk = _record(
            Chunk(self._compression, data, end_ns, start_ns, zlib.crc32(records), len(records))
        )
        at = self._stream.tell()
        offsets: dict[int, int] = {}
        indexes = b""
        for channel, entries in index.items():
            offsets[channel] = at + len(chunk) + len(indexes)
            head = (Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries))
            indexes += struct.pack("<BQHI", *head) + entries
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=at,
                compression=self._compression,
                compressed_size=len(data),
                message_end_time=end_ns,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=start_ns,
                uncompressed_size=len(records),
            )
        )
        self._write(chunk)
        self._write(indexes)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record, before the chunk that is being collected."""
        record = _record(Metadata(name, data))
        self._metadata.append(MetadataIndex(self._stream.tell(), len(record), name))
        self._write(record)

    def flush(self) -> None:
        """Write the chunk that is being collected, and hand everything to the operating system."""
        self._finish_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the end of the data, the summary and the footer."""
        self._finish_chunk()
        self._stream.write(_record(DataEnd(self._crc)))
        at = self._stream.tell()
        groups: list[tuple[Opcode, Iterable[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(map(_record, records))
            offsets += _record(SummaryOffset(opcode, at + len(summary), len(group)))
            summary += group
        offsets_at = at + len(summary)
        summary += offsets
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, at, offsets_at)
        self._stream.write(summary)
        self._stream.write(
            _record(Footer(at, offsets_at, zlib.crc32(footer_head, zlib.crc32(summary)))) + MAGIC
        )

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self.counts,
            chunk_count=len(self._chunks),
            message_count=sum(self.counts.values()),
            message_end_time=self.last_ns,
            message_start_time=self.first_ns or 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


class RecordingWriter:
    """Writes an MCAP file: profile ``ros2``, CDR, ``ros2msg`` schemas, chunks, all checksums on.

    As a context manager it finishes the file as complete, or, after an exception, as incomplete
    with the reason. After a failed write (a full disk) nothing more is written: the file ends
    there, without an end record, and is read as incomplete.
    """

    def __init__(
        self, path: str | Path, compression: str = "zstd", *, overwrite: bool = False
    ) -> None:
        """Create the file.

        Raises FileExistsError if it exists, unless ``overwrite``, and BlockingIOError if it is being written.
        """
        self.path = Path(path)
        self._file = open_own(self.path, overwrite=overwrite)
        self._named = False  # does the disk know of the file?
        self._writer = ChunkedWriter(self._file, _COMPRESSIONS[compression], self._digest)
        self._schemas: dict[str, int] = {}
        self._topics: dict[int, str] = {}
        self._types: dict[int, str] = {}
        self._digests = RunningDigests()
        self._failure: OSError | None = None
        self._syncing: Thread | None = None
        self._writer.start(PROFILE, _LIBRARY)
        self._digests.header(PROFILE, _LIBRARY)

    def channel(self, topic: str, type_name: str) -> int:
        """Add a topic, unless it is there, and return its channel. Raises ValueError for an unknown type."""
        for number, name in self._topics.items():
            if name == topic and self._types[number] == type_name:
                return number
        text = definition(type_name)
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", text)
        schema = self._schemas[type_name]
        metadata = rosbag2.channel_metadata(topic, type_name)
        channel = self._writer.register_channel(topic, "cdr", schema, metadata)
        self._topics[channel] = topic
        self._types[channel] = type_name
        self._digests.channel(
            Channel(channel, topic, "cdr", metadata, schema),
            Schema(schema, text, "ros2msg", type_name),
        )
        return channel

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, cdr: bytes) -> None:
        """Write one message; both times in ns, not negative. Raises OSError if it fails."""
        self._check()
        try:
            self._writer.add_message(channel, log_time_ns, cdr, publish_time_ns)
        except OSError as error:
            raise self._failed(error) from None

    def write_rows(self, rows: Sequence[Rows]) -> None:
        """Write messages of several channels by their place. Raises OSError if it fails."""
        self._check()
        try:
            self._writer.add_rows(rows)
        except OSError as error:
            raise self._failed(error) from None

    def _digest(self, heads: bytes, messages: Mapping[int, bytes]) -> None:
        self._digests.heads(heads)
        for channel, joined in messages.items():
            self._digests.messages(self._topics[channel], joined)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a record of names and values, after all messages so far."""
        self.flush()
        try:
            self._writer.add_metadata(name, dict(data))
        except OSError as error:
            raise self._failed(error) from None
        self._digests.metadata(name, data)

    def flush(self) -> None:
        """Finish the chunk and hand everything to the operating system: SIGKILL then loses nothing.

        Raises OSError if it fails, also where `check` does.
        """
        self.check()  # before too: what is written now would fill up a file that was truncated
        try:
            self._writer.flush()
        except OSError as error:
            raise self._failed(error) from None
        self.check()

    def check(self) -> None:
        """Raise OSError if the file has been deleted, renamed, replaced or truncated.

        Nobody who opens its path could read what is written from then on.
        """
        self._check()
        try:
            check_own(self._file, self.path)
        except OSError as error:
            raise self._failed(error) from None

    def sync_beside(self) -> None:
        """Begin `sync` in another thread, unless it is under way; what follows raises its OSError."""

        def sync() -> None:
            with suppress(OSError):
                self.sync()

        if self._syncing is None or not self._syncing.is_alive():
            self._syncing = Thread(target=sync, name="sync")
            self._syncing.start()

    def sync(self) -> None:
        """Wait until the disk has what was flushed, and the file its name.

        Raises OSError if it fails, as does whatever follows: the system tells of a lost write once. A pipe or
        a device has no disk to wait for.
        """
        try:
            os.fdatasync(self._file.fileno())
            if not self._named:
                folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)
                self._named = True
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EROFS):
                raise self._failed(error) from None

    def finish(self, *, complete: bool, reason: str, sync: bool = False) -> None:
        """Write the end record, the digests and the index, and close the file; a second call does nothing.

        ``sync``: the disk then has it, too.
        Raises OSError, with the file closed, if a write has failed.
        """
        if self._file.closed:
            return
        if self._syncing is not None:
            self._syncing.join()  # the file stays open for it
        try:
            self.flush()
            self.add_metadata(rosbag2.RECORD, rosbag2.summary_record(self.summary()))
            self.add_metadata(END, {"complete": str(complete).lower(), "reason": reason})
            self.add_metadata(DIGESTS, self._digests.values())
            self._writer.finish()
            self._file.flush()
            self.check()
            if sync:
                self.sync()
            self._file.close()
        except OSError as error:
            with suppress(OSError):
                self._file.close()
            raise self._failed(error) from None

    def summary(self) -> rosbag2.BagSummary:
        """Return the topics and messages of the last flush, in rosbag2's words."""
        counts = tuple(
            rosbag2.TopicCount(topic, self._types[channel], self._writer.counts.get(channel, 0))
            for channel, topic in self._topics.items()
        )
        return rosbag2.BagSummary(counts, self._writer.first_ns or 0, self._writer.last_ns)

    def _failed(self, error: OSError) -> OSError:
        """Return the first failure, naming the file; nothing is written after it."""
        if self._failure is None:
            self._failure = OSError(error.errno, error.strerror, str(self.path))
        return self._failure

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.finish(complete=True, reason="finished")
        else:
            text = " ".join(str(error).split())
            self.finish(complete=False, reason=f"{type(error).__name__}: {text}".removesuffix(": "))
