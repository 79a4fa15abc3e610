"""Reads the statistics and indexes at an MCAP file's end, without the messages."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Footer,
    MetadataIndex,
    Schema,
    Statistics,
)

from .blocks import MAGIC, Record, damaged
from .limits import MAX_CHUNK
from .messages import HEAD
from .split import record_offsets

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .joint_arrays import Integers

_FOOTER = HEAD.size + 20
_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, length of the entries


@dataclass
class Summary:
    """The summary section; ``start`` is where it begins."""

    start: int
    footer: Footer
    crc: int  # of what the footer's checksum covers
    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    statistics: Statistics | None = None
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)


def read_summary(file: BinaryIO, size: int) -> Summary | None:
    """Return the summary of a file of ``size`` bytes, or None if it has none.

    Raises ValueError if the summary makes no sense; its checksum is not checked.
    """
    at = size - len(MAGIC) - _FOOTER
    if at < len(MAGIC):
        return None
    file.seek(at)
    tail = file.read(size - at)
    if not tail.endswith(MAGIC) or HEAD.unpack_from(tail) != (Opcode.FOOTER, 20):
        return None
    footer = Footer.read(ReadDataStream(BytesIO(tail[HEAD.size : _FOOTER])))
    start = footer.summary_start
    if not start:
        return None
    if not len(MAGIC) <= start <= at or at - start > MAX_CHUNK:
        raise ValueError(f"the footer says that the summary begins at byte {start}")
    file.seek(start)
    data = file.read(at - start)
    crc = zlib.crc32(tail[: _FOOTER - 4], zlib.crc32(data))
    summary = Summary(start, footer, crc)
    offsets, end = record_offsets(data)
    if end != len(data):
        raise ValueError("a record of the summary goes beyond it")
    ends = [*offsets.tolist()[1:], end]
    for offset, until in zip(offsets.tolist(), ends, strict=True):
        record = Record(start + offset, data[offset], data[offset + HEAD.size : until], until)
        try:
            _take(summary, record)
        except Exception as error:  # whatever mcap may raise on a damaged record
            raise ValueError(f"in the summary, {damaged(record, error)}") from None
    return summary


def _take(summary: Summary, record: Record) -> None:
    if record.opcode == Opcode.SCHEMA:
        summary.schemas.append(Schema.read(record.stream))
    elif record.opcode == Opcode.CHANNEL:
        summary.channels.append(Channel.read(record.stream))
    elif record.opcode == Opcode.STATISTICS:
        summary.statistics = Statistics.read(record.stream)
    elif record.opcode == Opcode.CHUNK_INDEX:
        summary.chunks.append(ChunkIndex.read(record.stream))
    elif record.opcode == Opcode.METADATA_INDEX:
        summary.metadata.append(MetadataIndex.read(record.stream))
    elif record.opcode == Opcode.ATTACHMENT_INDEX:
        summary.attachments.append(AttachmentIndex.read(record.stream))


def miscounted(statistics: Statistics, counts: Mapping[int, int]) -> str:
    """Return how statistics differ from a file's messages by channel; empty if they agree."""
    told = {channel: n for channel, n in statistics.channel_message_counts.items() if n}
    total = sum(counts.values())
    if statistics.message_count == total and told in ({}, counts):
        return ""
    return (
        f"statistics count {statistics.message_count} messages, there are {total}, "
        "or they are on other channels"
    )


def message_indexes(file: BinaryIO, index: ChunkIndex) -> dict[int, tuple[Integers, Integers]]:
    """Return (log times in ns, offsets in the chunk's records) by channel, of one chunk.

    Raises ValueError if they are not where the chunk's index says.
    """
    first = index.chunk_start_offset + index.chunk_length
    if index.message_index_length > MAX_CHUNK:
        raise ValueError(f"message indexes of {index.message_index_length} bytes")
    file.seek(first)
    data = file.read(index.message_index_length)
    found = {}
    for channel, offset in index.message_index_offsets.items():
        at = offset - first
        if not 0 <= at <= len(data) - _INDEX_HEAD.size:
            raise ValueError(f"the message index at byte {offset} is not after its chunk")
        opcode, length, told, size = _INDEX_HEAD.unpack_from(data, at)
        begin = at + _INDEX_HEAD.size
        if opcode != Opcode.MESSAGE_INDEX or told != channel or length < size + 6 or size % 16:
            raise ValueError(f"there is no index of channel {channel} at byte {offset}")
        if begin + size > len(data):
            raise ValueError(f"the message index at byte {offset} is too long")
        entries = np.frombuffer(data, "<i8", size // 8, begin).reshape(-1, 2)
        found[channel] = (entries[:, 0], entries[:, 1])
    return found
