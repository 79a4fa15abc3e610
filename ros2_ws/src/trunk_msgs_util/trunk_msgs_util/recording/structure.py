"""The structure of an MCAP file: lengths, checksums, indexes against contents; each with its byte."""

from __future__ import annotations

import zlib
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, MetadataIndex

from ..units import seconds
from .blocks import (
    BLOCKS,
    ChecksumError,
    DamageError,
    LimitReachedError,
    Record,
    TrailingError,
    content_of,
    is_known,
    name_of,
    records,
)
from .chunk import chunk_head
from .file import check_magic, miscounted, size_of
from .joint_arrays import Integers
from .limits import Budget
from .messages import MAGIC
from .split import Content
from .summary import Summary, message_indexes, read_summary

ERROR, WARNING, INFO = "error", "warning", "info"
# Records other than chunks that an index lists, with their names in messages.
_INDEXED = {Opcode.METADATA: "the metadata record", Opcode.ATTACHMENT: "the attachment"}


@dataclass(frozen=True)
class Finding:
    """A finding about a recording and its place; None if a place makes no sense."""

    severity: str  # ERROR: wrong or lost; WARNING: missing; INFO
    message: str
    topic: str | None = None
    stamp_ns: int | None = None
    byte: int | None = None

    def describe(self) -> str:
        """Return the finding as one line, place first."""
        place = [
            *([self.topic] if self.topic is not None else []),
            *([f"t = {seconds(self.stamp_ns):.9g} s"] if self.stamp_ns is not None else []),
            *([f"byte {self.byte}"] if self.byte is not None else []),
        ]
        return ": ".join([*([", ".join(place)] if place else []), self.message])


def structure(path: Path, walk: Walk | None = None) -> list[Finding]:
    """Return the faults in a file's structure. Raises RecordingError if it is not MCAP.

    ``walk``: what a pass through an undamaged file has seen; without it, the file is read here.
    """
    size = size_of(path)
    if walk is not None:
        with path.open("rb") as file:
            return [*walk.findings, *_summary(file, size, walk)]
    walk = Walk(size)
    findings = walk.findings
    with path.open("rb") as file:
        check_magic(path, file, size)
        try:
            for record in records(file, size):
                walk.take(record)
        except DamageError as error:
            if isinstance(error, TrailingError):
                walk.end = size = walk.end + len(MAGIC)
            findings.append(Finding(ERROR, str(error), byte=walk.end))
            if not isinstance(error, ChecksumError | TrailingError):
                return findings
        findings += _summary(file, size, walk)
    return findings


class _SeenChunk(NamedTuple):
    """A chunk as it is in the file."""

    end: int
    span_ns: tuple[int, int]
    marks: dict[int, int]  # of its messages, by channel


class Walk:
    """What a pass through the records has seen, to check the indexes against."""

    def __init__(self, size: int) -> None:
        self.budget = Budget(size)
        self.end = 8
        self.counts: dict[int, int] = {}
        self.chunks: dict[int, _SeenChunk] = {}  # by offset
        self.records: dict[int, set[int]] = {o: set() for o in _INDEXED}  # offsets by opcode
        self.outside = 0  # messages outside chunks
        self.data_end: int | None = None
        self.findings: list[Finding] = []

    def take(self, record: Record, content: Content | None = None) -> None:
        """Count a record, of a block its content too, and note what is wrong with it."""
        self.findings += self._faults(record, content)

    def _faults(self, record: Record, content: Content | None) -> Iterator[Finding]:
        self.end = record.end
        if record.opcode == Opcode.DATA_END:
            self.data_end = record.end
            if not any(record.body[:4]):
                text = "no checksum of the data section: changes outside chunks go undetected"
                yield Finding(INFO, text, byte=record.offset)
        elif record.opcode in _INDEXED and self.data_end is None:
            self.records[record.opcode].add(record.offset)
        elif not is_known(record.opcode):
            yield _skipped(record, record.opcode)
        elif record.opcode in BLOCKS:
            try:
                content = content_of(record, self.budget) if content is None else content
            except LimitReachedError:
                raise
            except DamageError as error:
                yield Finding(ERROR, str(error), byte=record.offset)
                return
            for channel, messages in content.channels.items():
                self.counts[channel] = self.counts.get(channel, 0) + len(messages)
            if record.opcode == Opcode.CHUNK:
                yield from _chunk(record, content)
                head = chunk_head(record.body)
                marks = {
                    channel: _mark(messages.log_time_ns, messages.offsets())
                    for channel, messages in content.channels.items()
                }
                self.chunks[record.offset] = _SeenChunk(
                    record.end, (head.start_ns, head.end_ns), marks
                )
            else:
                self.outside += sum(map(len, content.channels.values()))


def _mark(log_time_ns: Integers, offsets: Integers) -> int:
    """Return a checksum of a channel's index entries, in the chunk's order."""
    order = np.argsort(offsets, kind="stable")
    return zlib.crc32(log_time_ns[order].tobytes(), zlib.crc32(offsets[order].tobytes()))


def _skipped(record: Record, opcode: int) -> Finding:
    text = f"a record of the unknown kind {name_of(opcode)} is skipped"
    return Finding(INFO, text, byte=record.offset)


def _chunk(record: Record, content: Content) -> Iterator[Finding]:
    for opcode in sorted({opcode for opcode, _ in content.others if not is_known(opcode)}):
        yield _skipped(record, opcode)
    head = chunk_head(record.body)
    if not head.crc:
        yield Finding(INFO, "the chunk has no checksum", byte=record.offset)
    times = [messages.log_time_ns.view(np.uint64) for messages in content.channels.values()]
    if times:
        span = min(int(t.min()) for t in times), max(int(t.max()) for t in times)
        if span != (head.start_ns, head.end_ns):
            text = "the chunk's time span is not that of its messages"
            yield Finding(ERROR, text, byte=record.offset)


def _summary(file: BinaryIO, size: int, walk: Walk) -> Iterator[Finding]:
    try:
        summary = read_summary(file, size)
    except ValueError as error:
        yield Finding(ERROR, str(error), byte=walk.end)
        return
    if summary is None:
        yield Finding(INFO, "no summary: readers have to scan the file", byte=size)
        return
    place = summary.start
    if place != walk.data_end:
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
            if index.offset not in walk.records[opcode]:
                text = f"the index has {_INDEXED[opcode]} {index.name!r} here, the file does not"
                yield Finding(ERROR, text, byte=index.offset)


def _others(summary: Summary) -> dict[Opcode, Sequence[MetadataIndex | AttachmentIndex]]:
    """Return the indexes of records other than chunks, by the kind that they are of."""
    return {Opcode.METADATA: summary.metadata, Opcode.ATTACHMENT: summary.attachments}


def _hidden(summary: Summary, walk: Walk) -> Iterator[Finding]:
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
        for offset in sorted(walk.records[opcode] - {index.offset for index in indexes}):
            if indexes:
                yield Finding(ERROR, f"{_INDEXED[opcode]} is not in the index", byte=offset)
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
    file: BinaryIO, chunk: ChunkIndex, walk: Walk, following: int
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
        channel: _mark(*entries) for channel, entries in indexes.items() if len(entries[0])
    } != seen.marks:
        yield Finding(
            ERROR, "the message indexes after the chunk are not those of its messages", byte=at
        )
