"""The statistics and indexes at an MCAP file's end: a file opened by them, and compared with its data.

Opened by them a file is known at once, whatever its length; nothing is checked.
"""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass, field, replace
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO

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

from .digests import DIGESTS, END, PROVENANCE, Content
from .mcap_file import (
    ERROR,
    INFO,
    OURS,
    STAMPED,
    Block,
    Finding,
    McapFile,
    Record,
    Topic,
    records,
)
from .messages import HEAD, LIMIT, MAGIC, MESSAGE_HEAD, allowed
from .schemas import describes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_FOOTER = HEAD.size + 20


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
    if not len(MAGIC) <= start <= at or at - start > LIMIT:
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


def open_by_summary(path: Path, topics: dict[str, Topic]) -> McapFile | None:
    """Return the file as its summary describes it, with its messages counted in ``topics``.

    Stamps are those of each channel's first and last chunk; sizes and gaps are not known. None if the summary
    is incomplete or does not fit the file.
    """
    recording = McapFile(path, {})
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            summary = read_summary(file, size)
            if summary is None or summary.statistics is None or not _fits(summary, size):
                return None
            recording.whole = True
            file.seek(8)
            recording.take_record(next(records(file, size)))  # the header
            _describe(recording, summary, file)
            for channel, count in summary.statistics.channel_message_counts.items():
                recording.topics[recording.channels[channel].topic].count += count
            _take_ends(recording, file)
    except Exception:  # whatever a damaged summary may raise: the file is scanned instead
        return None
    if any(name in topics and topics[name].count for name in recording.topics):
        return None  # topics continue from an earlier file
    topics.update(recording.topics)
    recording.topics = topics
    return recording


def _fits(summary: Summary, size: int) -> bool:
    """Return whether the summary is complete and its chunks are contiguous."""
    statistics = summary.statistics
    if statistics is None or summary.footer.summary_crc not in (0, summary.crc):
        return False
    count, unpacked = statistics.message_count, sum(c.uncompressed_size for c in summary.chunks)
    end = 8
    for chunk in summary.chunks:
        if chunk.chunk_start_offset < end or not chunk.message_index_offsets:
            return False
        end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
    return (
        end <= summary.start
        and count == sum(statistics.channel_message_counts.values())
        and count * MESSAGE_HEAD.size <= unpacked <= allowed(size)
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


def _take_ends(recording: McapFile, file: BinaryIO) -> None:
    """Take the stamps of each channel's first and last chunk."""
    ends: dict[int, tuple[Block, Block]] = {}
    for block in recording.blocks:
        ends |= {channel: (ends.get(channel, (block,))[0], block) for channel in block.channels}
    for block in recording.blocks:
        wanted = {channel for channel in block.channels if block in ends[channel]}
        content = recording.content(file, block) if wanted else Content(b"")
        for topic, messages in recording.by_topic(content).items():
            if wanted & set(recording.numbers(topic)):
                recording.topics[topic].take_stamps(messages)


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
            twice = f"{counts[name]} records {name}: other readers may take any of them"
            yield Finding(ERROR, twice)
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
