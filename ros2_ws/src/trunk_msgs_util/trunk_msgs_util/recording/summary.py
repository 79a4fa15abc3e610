"""The statistics and indexes at an MCAP file's end: a file opened by them, and compared with its data.

Opened by them a file is known at once, whatever its length; nothing is checked.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field, replace
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
from .digests import DIGESTS, END, PROVENANCE
from .limits import MAX_CHUNK, Budget
from .mcap_file import (
    ERROR,
    INFO,
    OURS,
    Block,
    Finding,
    McapFile,
    Record,
    content_of,
    read_block,
    records,
)
from .messages import HEAD, MAGIC
from .schemas import describes
from .topic import STAMPED, Topic

if TYPE_CHECKING:
    from collections.abc import Iterator
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
    findings = [*file.findings, *_ambiguous(file)]
    if file.whole:
        with file.path.open("rb") as stream:
            findings += _compared(stream, file.size, file)
    return findings


def _ambiguous(file: McapFile) -> Iterator[Finding]:
    """Yield our records that come twice, and types whose fields a schema gives otherwise."""
    counts = Counter(name for name, _ in file.metadata_records)
    for name in (PROVENANCE, END, DIGESTS):
        if counts[name] > 1:
            said = f"{counts[name]} records {name}: other readers may take any of them"
            yield Finding(ERROR, said)
    texts = [(s.name, s.data) for s in file.schemas.values() if s.encoding == "ros2msg"]
    for name, text in dict.fromkeys(texts):
        if text and name in STAMPED and not describes(text, name):
            yield Finding(ERROR, f"the schema of {name} has other fields than the type")


def _compared(file: BinaryIO, size: int, walk: McapFile) -> Iterator[Finding]:
    """Yield where the summary is not the one that the data give: other readers go by it."""
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
    if walk.chunks and not summary.chunks:
        yield Finding(INFO, "no index of chunks: readers have to scan the file", byte=place)
    if walk.outside and summary.chunks:
        text = f"{walk.outside} messages outside of chunks are in no index"
        yield Finding(ERROR, text, byte=place)
    for part, (given, stated) in _parts(summary, walk).items():
        # Of what others write, any part may be missing; other readers may need what our recorder writes.
        if (stated or walk.library.startswith(OURS)) and stated != given:
            text = f"the summary's {part} are not those of the data: other readers may see another recording"
            yield Finding(ERROR, text, byte=place)
    if any(index.message_index_offsets for index in walk.chunks.values()):
        for block in walk.blocks:
            index = walk.chunks.get(block.offset)
            if index is not None and block.channels - index.message_index_offsets.keys():
                yield Finding(ERROR, "the chunk lacks message indexes", byte=block.offset)


def _parts(summary: Summary, walk: McapFile) -> dict[str, tuple[list[Any], list[Any]]]:
    """Return the summary's parts, as the data give them and as they are, in the order of their places."""
    counted = summary.statistics and replace(
        summary.statistics,
        message_start_time=walk.span_ns[0],
        message_end_time=walk.span_ns[1],
        chunk_count=len(walk.chunks),
        schema_count=len(walk.schemas),
        channel_count=len(walk.channels),
        metadata_count=len(walk.metadata_records),
        attachment_count=walk.attachments,
    )
    return {
        "channels": (
            sorted(walk.channels.values(), key=lambda c: c.id),
            sorted(summary.channels, key=lambda c: c.id),
        ),
        "schemas": (
            sorted(walk.schemas.values(), key=lambda s: s.id),
            sorted(summary.schemas, key=lambda s: s.id),
        ),
        "chunks": (
            list(walk.chunks.values()),
            sorted(summary.chunks, key=lambda c: c.chunk_start_offset),
        ),
        "metadata records": (
            walk.metadata_index,
            sorted((i.offset, i.length, i.name) for i in summary.metadata),
        ),
        "attachments": (
            walk.attachment_index,
            sorted((i.offset, i.length) for i in summary.attachments),
        ),
        "statistics": ([counted], [summary.statistics]),
    }
