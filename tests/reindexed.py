"""A recording whose records are kept or padded, and whose summary is written anew after an edit."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, McapRecord

from trunk_msgs_util.recording.summary import Summary, read_summary

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
Edit = Callable[[Summary], object]


def raw(opcode: int, body: bytes = b"") -> bytes:
    """Return a record of any kind."""
    return HEAD.pack(opcode, len(body)) + body


def records_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (kind, start, end) of a whole file's records."""
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = HEAD.unpack_from(data, at)
        yield opcode, at, at + HEAD.size + length
        at += HEAD.size + length


def data_of(whole: bytes) -> bytes:
    """Return a file up to its data's end: magic, header, data."""
    return whole[: next(at for opcode, at, _ in records_of(whole) if opcode == Opcode.DATA_END)]


def summary_of(path: Path) -> Summary:
    """Return a file's summary."""
    with path.open("rb") as file:
        found = read_summary(file, path.stat().st_size)
    assert found is not None
    return found


def as_bytes(records: Iterable[McapRecord]) -> bytes:
    """Return records as they are in a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def with_summary(data: bytes, summary: Summary, at: int = 0) -> bytes:
    """Return a whole file of some data; ``at``: where its first byte is said to be."""
    data += raw(Opcode.DATA_END, struct.pack("<I", zlib.crc32(data)))
    statistics = [summary.statistics] if summary.statistics else []
    text = as_bytes(
        [
            *summary.schemas,
            *summary.channels,
            *statistics,
            *summary.metadata,
            *summary.attachments,
            *summary.chunks,
        ]
    )
    footer = as_bytes([Footer(at + len(data), 0, 0)])
    crc = zlib.crc32(footer[:-4], zlib.crc32(text))
    return data + text + footer[:-4] + struct.pack("<I", crc) + MAGIC


def reindexed(source: Path, target: Path, edit: Edit, more: bytes = b"") -> Path:
    """Write a recording anew: its data with ``more`` after them, its summary edited, checksums right."""
    summary = summary_of(source)
    edit(summary)
    target.write_bytes(with_summary(data_of(source.read_bytes()) + more, summary))
    return target


def moved(index: ChunkIndex, by: int) -> ChunkIndex:
    """Return a chunk's index with its places moved by so many bytes."""
    places = {channel: at + by for channel, at in index.message_index_offsets.items()}
    start = index.chunk_start_offset + by
    return replace(index, chunk_start_offset=start, message_index_offsets=places)
