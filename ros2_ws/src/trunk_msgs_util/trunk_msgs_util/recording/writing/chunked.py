"""`ChunkedWriter`: an MCAP file in chunks, byte for byte what ``mcap.writer.Writer`` makes of the same calls.

The library takes ten microseconds for a message, most of what recording costs. Here a message is packed
once; checksums and index are made chunk by chunk. All other records are the library's own.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable, Sequence
from typing import BinaryIO

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

from ..messages import HEAD, MAGIC, MESSAGE_HEAD
from .interleaved import Interleaved, Rows, interleaved

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
    """Writes header, chunks with their indexes, metadata, and a summary; all checksums are on."""

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
        """Add messages of several channels by their place, as so many calls of `add_message` would."""
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
