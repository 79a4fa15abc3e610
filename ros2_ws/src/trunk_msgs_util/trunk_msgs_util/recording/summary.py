"""Reads the statistics and indexes at an MCAP file's end, and opens a file by them, without the messages.

That is instant, whatever the file's length; nothing is checked.
"""

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

from .blocks import Record, content_of, damaged, read_block, records
from .file import Block, RecordingFile
from .limits import MAX_CHUNK, Budget
from .messages import HEAD, MAGIC
from .split import Content, record_offsets
from .topic import Topic

if TYPE_CHECKING:
    from pathlib import Path

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


def message_indexes(file: BinaryIO, index: ChunkIndex) -> dict[int, tuple[Integers, Integers]]:
    """Return (log times in ns, offsets in the chunk's records) by channel, of one chunk.

    Raises ValueError if they are not where the chunk's index says.
    """
    first = index.chunk_start_offset + index.chunk_length
    if index.message_index_length > MAX_CHUNK:
        raise ValueError(f"message indexes of {index.message_index_length} bytes")
    file.seek(first)
    data = file.read(index.message_index_length)
    indexes = {}
    for channel, offset in index.message_index_offsets.items():
        at = offset - first
        if not 0 <= at <= len(data) - _INDEX_HEAD.size:
            raise ValueError(f"the message index at byte {offset} is not after its chunk")
        opcode, length, number, size = _INDEX_HEAD.unpack_from(data, at)
        begin = at + _INDEX_HEAD.size
        if opcode != Opcode.MESSAGE_INDEX or number != channel or length < size + 6 or size % 16:
            raise ValueError(f"there is no index of channel {channel} at byte {offset}")
        if begin + size > len(data):
            raise ValueError(f"the message index at byte {offset} is too long")
        entries = np.frombuffer(data, "<i8", size // 8, begin).reshape(-1, 2)
        indexes[channel] = (entries[:, 0], entries[:, 1])
    return indexes


def open_by_summary(path: Path, topics: dict[str, Topic]) -> RecordingFile | None:
    """Return the file as its summary describes it, with ``topics`` filled as by a scan.

    A topic's size is that of the messages in its first and last chunk if these are all equal, or
    else 0. None if the summary is incomplete or does not fit the file.
    """
    described: dict[str, Topic] = {}
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            summary = read_summary(file, size)
            if summary is None or not _fits(summary):
                return None
            recording = RecordingFile(path, described)
            recording.whole = True
            file.seek(8)
            for record in records(file, size):
                recording.take_record(record)
                break  # the header
            _describe(recording, summary, file)
            _measure(recording, summary, file)
    except Exception:  # whatever a damaged summary may raise: the file is scanned instead
        return None
    if any(name in topics and topics[name].count for name in described):
        return None  # topics continue from an earlier file: their gaps are not known here
    topics.update(described)
    return recording


def _fits(summary: Summary) -> bool:
    """Return whether the summary is complete and its chunks are contiguous."""
    statistics = summary.statistics
    if statistics is None or summary.footer.summary_crc not in (0, summary.crc):
        return False
    end = 8
    for chunk in summary.chunks:
        if chunk.chunk_start_offset < end or not chunk.message_index_offsets:
            return False
        end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
    return (
        end <= summary.start
        and statistics.chunk_count == len(summary.chunks) > 0
        and statistics.channel_count == len(summary.channels)
        and statistics.metadata_count == len(summary.metadata)
    )


def _describe(recording: RecordingFile, summary: Summary, file: BinaryIO) -> None:
    """Read schemas, channels, metadata records and the places of the chunks."""
    described: list[Schema | Channel] = [*summary.schemas, *summary.channels]
    for item in described:
        recording.take_described(item)
    for index in summary.metadata:
        file.seek(index.offset)
        data = file.read(index.length)
        if data[0] != Opcode.METADATA:
            raise ValueError("no metadata where the index says")
        end = index.offset + index.length
        recording.take_record(Record(index.offset, data[0], data[HEAD.size :], end))
    for chunk in summary.chunks:
        end = chunk.chunk_start_offset + chunk.chunk_length
        channels = frozenset(chunk.message_index_offsets)
        recording.blocks.append(Block(chunk.chunk_start_offset, end, channels))


def _measure(recording: RecordingFile, summary: Summary, file: BinaryIO) -> None:
    """Fill in the topics: counts and log times by the indexes, stamps by their first and last chunks."""
    counts: dict[int, int] = {}
    spans: dict[int, list[tuple[int, int]]] = {}  # of a channel: log time, the chunk that has it
    for i, chunk in enumerate(summary.chunks):
        for channel, (log, _) in message_indexes(file, chunk).items():
            if len(log):
                counts[channel] = counts.get(channel, 0) + len(log)
                if (log < 0).any():
                    raise ValueError("a log time is beyond the year 2262")
                topic = recording.topics[recording.channels[channel].topic]
                topic.take_log(log)
                spans.setdefault(channel, []).extend([(int(log.min()), i), (int(log.max()), i)])
    statistics = summary.statistics
    if statistics is None or counts != {
        channel: count for channel, count in statistics.channel_message_counts.items() if count
    }:
        raise ValueError("statistics and indexes do not agree")
    ends = {channel: {min(times)[1], max(times)[1]} for channel, times in spans.items()}
    sizes_of: dict[int, set[int]] = {}
    budget = Budget(recording.path.stat().st_size)
    for i in sorted(set().union(*ends.values())):
        content = _content(file, summary.chunks[i], budget)
        for channel in summary.chunks[i].message_index_offsets:
            if i in ends.get(channel, ()):
                messages = content.channels[channel]
                recording.topics[recording.channels[channel].topic].take_stamps(messages)
                lengths = np.unique(messages.end - messages.start)
                sizes_of.setdefault(channel, set()).update(lengths[:2].tolist())
    for channel, sizes in sizes_of.items():
        topic = recording.topics[recording.channels[channel].topic]
        before = topic.count
        topic.count = before + counts[channel]
        topic.size = counts[channel] * sizes.pop() if len(sizes) == 1 and not before else 0


def _content(file: BinaryIO, chunk: ChunkIndex, budget: Budget) -> Content:
    at = chunk.chunk_start_offset
    record = read_block(file, at, at + chunk.chunk_length)
    if record.opcode != Opcode.CHUNK:
        raise ValueError("no chunk where the index says")
    return content_of(record, budget)
