"""The statistics and indexes at an MCAP file's end: a file opened by them, and compared with its data.

Opened by them a file is known at once, whatever its length; nothing is checked.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO

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
from mcap.stream_reader import StreamReader

from .content import Content
from .limits import MAX_CHUNK, Budget
from .mcap_file import (
    ERROR,
    INDEXED,
    INFO,
    OURS,
    Block,
    Finding,
    McapFile,
    Record,
    content_of,
    mark,
    miscounted,
    read_block,
    records,
)
from .messages import HEAD, MAGIC
from .topic import Topic

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from .joint_table import Integers

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
    data = file.read(size - start)
    summary = Summary(start, footer, zlib.crc32(data[: -len(MAGIC) - 4]))
    kinds: dict[type, list[Any]] = {
        Schema: summary.schemas,
        Channel: summary.channels,
        ChunkIndex: summary.chunks,
        MetadataIndex: summary.metadata,
        AttachmentIndex: summary.attachments,
    }
    try:
        for record in StreamReader(BytesIO(data), True, True, record_size_limit=len(data)).records:
            if isinstance(record, Statistics):
                summary.statistics = record
            else:
                kinds.get(type(record), []).append(record)
    except Exception as error:  # whatever mcap may raise on a damaged record
        raise ValueError(f"the summary is damaged ({type(error).__name__}: {error})") from None
    return summary


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


def open_by_summary(path: Path, topics: dict[str, Topic]) -> McapFile | None:
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
            recording = McapFile(path, described)
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


def _describe(recording: McapFile, summary: Summary, file: BinaryIO) -> None:
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


def _measure(recording: McapFile, summary: Summary, file: BinaryIO) -> None:
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


def structure(file: McapFile) -> list[Finding]:
    """Return the faults in a file's structure, its indexes among them. Raises RecordingError and OSError.

    A file that was opened by its summary is read here.
    """
    if not file.size:
        file = McapFile(file.path, {})
        file.scan()
    findings = list(file.findings)
    if file.whole:
        with file.path.open("rb") as stream:
            findings += _compared(stream, file.size, file)
    return findings


def _compared(file: BinaryIO, size: int, walk: McapFile) -> Iterator[Finding]:
    try:
        summary = read_summary(file, size)
    except ValueError as error:
        yield Finding(ERROR, str(error), byte=walk.end)
        return
    if summary is None:
        yield Finding(INFO, "no summary: readers have to scan the file", byte=size)
        return
    place = summary.start
    if walk.data_end not in (None, place):  # None: the data's checksum is wrong
        text = f"the footer has the summary here, the data end at byte {walk.data_end}"
        yield Finding(ERROR, text, byte=place)
    if not summary.footer.summary_crc:
        yield Finding(INFO, "no checksum of the summary", byte=place)
    elif summary.footer.summary_crc != summary.crc:
        yield Finding(ERROR, "the checksum of summary and footer is wrong", byte=place)
    if summary.statistics is None:
        yield Finding(INFO, "no statistics", byte=place)
    elif text := miscounted(summary.statistics, walk.counts):
        yield Finding(ERROR, text, byte=place)
    yield from _hidden(summary, walk)
    if summary.statistics is not None and (text := _misstated(summary.statistics, walk)):
        yield Finding(ERROR, text, byte=place)
    starts = [*sorted(walk.chunks), size]
    seen: set[int] = set()
    for chunk in summary.chunks:
        at = chunk.chunk_start_offset
        if at in seen:
            yield Finding(ERROR, "the index has the chunk twice", byte=at)
        else:
            seen.add(at)
            following = starts[min(bisect_right(starts, at), len(starts) - 1)]
            yield from _chunk_index(file, chunk, walk, following)
    for opcode, indexes in _others(summary).items():
        for index in indexes:
            length, name = walk.indexed[opcode].get(index.offset, (0, ""))
            if not length:
                text = f"the index has {INDEXED[opcode]} {index.name!r} here, the file does not"
                yield Finding(ERROR, text, byte=index.offset)
            elif index.length != length or (
                isinstance(index, MetadataIndex) and index.name != name
            ):
                text = f"the index gives {INDEXED[opcode]} another name or length"
                yield Finding(ERROR, text, byte=index.offset)


def _misstated(statistics: Statistics, walk: McapFile) -> str:
    """Return how statistics differ from the file, besides its messages; empty if they agree."""
    expected = {
        "message_start_time": walk.span_ns[0],
        "message_end_time": walk.span_ns[1],
        "chunk_count": len(walk.chunks),
        "schema_count": len(walk.schemas),
        "channel_count": len(walk.channels),
        "metadata_count": len(walk.metadata_records),
        "attachment_count": walk.attachments,
    }
    return "; ".join(
        f"statistics have {name} {stated}, by the file it is {value}"
        for name, value in expected.items()
        if (stated := getattr(statistics, name)) != value
    )


def _others(summary: Summary) -> dict[Opcode, Sequence[MetadataIndex | AttachmentIndex]]:
    """Return the indexes of records other than chunks, by the kind that they are of."""
    return {Opcode.METADATA: summary.metadata, Opcode.ATTACHMENT: summary.attachments}


def _hidden(summary: Summary, walk: McapFile) -> Iterator[Finding]:
    """Yield the records hidden from readers that go by the summary; without any index they scan the file."""
    place = summary.start
    if walk.chunks and not summary.chunks:
        yield Finding(INFO, "no index of chunks: readers have to scan the file", byte=place)
    if summary.chunks:
        for offset in sorted(walk.chunks.keys() - {c.chunk_start_offset for c in summary.chunks}):
            yield Finding(ERROR, "the chunk is not in the index", byte=offset)
        for chunk in summary.chunks if any(c.message_index_offsets for c in summary.chunks) else ():
            seen = walk.chunks.get(chunk.chunk_start_offset)
            if seen is not None and seen.marks and not chunk.message_index_offsets:
                text = "the index has no message indexes of the chunk, but of others"
                yield Finding(ERROR, text, byte=chunk.chunk_start_offset)
        if walk.outside:
            text = f"{walk.outside} messages outside of chunks are in no index"
            yield Finding(ERROR, text, byte=place)
    for opcode, indexes in _others(summary).items():
        for offset in sorted(walk.indexed[opcode].keys() - {index.offset for index in indexes}):
            if indexes:
                yield Finding(ERROR, f"{INDEXED[opcode]} is not in the index", byte=offset)
    groups = {
        "channels": (walk.channels, summary.channels),
        "schemas": (walk.schemas, summary.schemas),
        "index of chunks": (walk.chunks, summary.chunks),
        "index of metadata records": (walk.indexed[Opcode.METADATA], summary.metadata),
    }
    for group, (there, listed) in groups.items():
        if there and not listed and walk.library.startswith(OURS):
            text = f"the summary has no {group}, which our recorder writes: others may not read the file"
            yield Finding(ERROR, text, byte=place)
    described = {channel.id for channel in summary.channels}
    schemas = {schema.id for schema in summary.schemas}
    for number in sorted(walk.counts.keys() - described):
        if described:
            text = f"the summary lacks channel {number}, of {walk.counts[number]} messages"
            yield Finding(ERROR, text, byte=place)
    for number in sorted({channel.schema_id for channel in summary.channels} - schemas - {0}):
        if schemas:
            yield Finding(ERROR, f"the summary lacks schema {number}", byte=place)


def _chunk_index(
    file: BinaryIO, chunk: ChunkIndex, walk: McapFile, following: int
) -> Iterator[Finding]:
    """Yield the faults of a chunk's index; ``following`` is where the next chunk begins."""
    at = chunk.chunk_start_offset
    seen = walk.chunks.get(at)
    if seen is None:
        yield Finding(ERROR, "the index has a chunk here that could not be read", byte=at)
        return
    if at + chunk.chunk_length != seen.end:
        yield Finding(ERROR, "the index gives the chunk another length", byte=at)
        return
    if (chunk.message_start_time, chunk.message_end_time) != seen.span_ns:
        yield Finding(ERROR, "the index gives the chunk another time span", byte=at)
    stated = chunk.compression, (chunk.compressed_size, chunk.uncompressed_size)
    if stated != (seen.compression, seen.sizes):
        yield Finding(ERROR, "the index gives the chunk another compression or size", byte=at)
    if not chunk.message_index_offsets:
        return  # optional in a file: `_hidden` looks for one that others have
    if seen.end + chunk.message_index_length > following:
        yield Finding(ERROR, "the message indexes of the chunk extend into the next one", byte=at)
        return
    try:
        indexes = message_indexes(file, chunk)
    except ValueError as error:
        yield Finding(ERROR, str(error), byte=at)
        return
    if {
        channel: mark(*entries) for channel, entries in indexes.items() if len(entries[0])
    } != seen.marks:
        yield Finding(
            ERROR, "the message indexes after the chunk are not those of its messages", byte=at
        )
