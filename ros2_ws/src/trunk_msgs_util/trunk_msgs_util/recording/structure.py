"""The structure of an MCAP file: lengths, checksums, indexes against contents; each with its byte."""

from __future__ import annotations

import zlib
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from ..units import seconds
from .blocks import (
    BLOCKS,
    ChecksumError,
    DamageError,
    LimitReachedError,
    Record,
    content_of,
    records,
)
from .chunk import chunk_head
from .file import check_magic, size_of
from .joint_arrays import Integers
from .limits import Budget
from .split import Content
from .summary import message_indexes, read_summary

ERROR, WARNING, INFO = "error", "warning", "info"


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


def structure(path: Path) -> list[Finding]:
    """Return what is wrong with a file's structure. Raises RecordingError if it is not MCAP."""
    size = size_of(path)
    found: list[Finding] = []
    with path.open("rb") as file:
        check_magic(path, file, size)
        walk = _Walk(size)
        try:
            for record in records(file, size):
                found += walk.take(record)
        except (ChecksumError, DamageError) as error:
            found.append(Finding(ERROR, str(error), byte=walk.end))
            if not isinstance(error, ChecksumError):
                return found
        found += _summary(file, size, walk)
    return found


class _Walk:
    """What a pass through the records has seen, to check the indexes against."""

    def __init__(self, size: int) -> None:
        self.budget = Budget(size)
        self.end = 8
        self.counts: dict[int, int] = {}
        self.chunks: dict[int, tuple[int, dict[int, int]]] = {}  # offset: end, marks by channel
        self.metadata: set[int] = set()
        self.in_data = True

    def take(self, record: Record) -> Iterator[Finding]:
        """Count a record; yield what is wrong with it."""
        self.end = record.end
        if record.opcode == Opcode.DATA_END:
            self.in_data = False
            if not any(record.body[:4]):
                text = "no checksum of the data section: changes outside chunks go undetected"
                yield Finding(INFO, text, byte=record.offset)
        elif record.opcode == Opcode.METADATA and self.in_data:
            self.metadata.add(record.offset)
        elif record.opcode in BLOCKS:
            try:
                content = content_of(record, self.budget)
            except LimitReachedError:
                raise
            except DamageError as error:
                yield Finding(ERROR, str(error), byte=record.offset)
                return
            for channel, messages in content.channels.items():
                self.counts[channel] = self.counts.get(channel, 0) + len(messages)
            if record.opcode == Opcode.CHUNK:
                yield from _chunk(record, content)
                marks = {
                    channel: _mark(messages.log_time_ns, messages.offsets())
                    for channel, messages in content.channels.items()
                }
                self.chunks[record.offset] = (record.end, marks)


def _mark(log_time_ns: Integers, offsets: Integers) -> int:
    """Return a checksum of a channel's index entries, in the chunk's order."""
    order = np.argsort(offsets, kind="stable")
    return zlib.crc32(log_time_ns[order].tobytes(), zlib.crc32(offsets[order].tobytes()))


def _chunk(record: Record, content: Content) -> Iterator[Finding]:
    head = chunk_head(record.body)
    if not head.crc:
        yield Finding(INFO, "the chunk has no checksum", byte=record.offset)
    times = [messages.log_time_ns for messages in content.channels.values()]
    if times:
        span = min(int(t.min()) for t in times), max(int(t.max()) for t in times)
        if span != (head.start_ns, head.end_ns):
            text = "the chunk's time span is not that of its messages"
            yield Finding(ERROR, text, byte=record.offset)


def _summary(file: BinaryIO, size: int, walk: _Walk) -> Iterator[Finding]:
    try:
        summary = read_summary(file, size)
    except ValueError as error:
        yield Finding(ERROR, str(error), byte=walk.end)
        return
    if summary is None:
        yield Finding(INFO, "no summary: readers have to scan the file", byte=size)
        return
    place = summary.start
    if not summary.footer.summary_crc:
        yield Finding(INFO, "no checksum of the summary", byte=place)
    elif summary.footer.summary_crc != summary.crc:
        yield Finding(ERROR, "the checksum of summary and footer is wrong", byte=place)
    if summary.statistics is None:
        yield Finding(INFO, "no statistics", byte=place)
    else:
        told = {c: n for c, n in summary.statistics.channel_message_counts.items() if n}
        if told != walk.counts:
            text = f"statistics count {sum(told.values())} messages, there are"
            text = f"{text} {sum(walk.counts.values())}, or they are on other channels"
            yield Finding(ERROR, text, byte=place)
    indexed = {chunk.chunk_start_offset for chunk in summary.chunks}
    if walk.chunks and not summary.chunks:
        yield Finding(INFO, "no index of chunks: readers have to scan the file", byte=place)
    else:
        for offset in sorted(walk.chunks.keys() - indexed):
            yield Finding(ERROR, "the chunk is not in the index", byte=offset)
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
    for index in summary.metadata:
        if index.offset not in walk.metadata:
            text = f"the index has a metadata record {index.name!r} here, the file does not"
            yield Finding(ERROR, text, byte=index.offset)


def _chunk_index(
    file: BinaryIO, chunk: ChunkIndex, walk: _Walk, following: int
) -> Iterator[Finding]:
    """Yield what is wrong with a chunk's index; ``following`` is where the next chunk begins."""
    at = chunk.chunk_start_offset
    end, marks = walk.chunks.get(at, (None, {}))
    if end is None:
        yield Finding(ERROR, "the index has a chunk here that could not be read", byte=at)
        return
    if at + chunk.chunk_length != end:
        yield Finding(ERROR, "the index gives the chunk another length", byte=at)
        return
    if not chunk.message_index_offsets:
        return  # optional in a file
    if end + chunk.message_index_length > following:
        yield Finding(ERROR, "the message indexes of the chunk extend into the next one", byte=at)
        return
    try:
        told = message_indexes(file, chunk)
    except ValueError as error:
        yield Finding(ERROR, str(error), byte=at)
        return
    if {channel: _mark(*entries) for channel, entries in told.items() if len(entries[0])} != marks:
        yield Finding(
            ERROR, "the message indexes after the chunk are not those of its messages", byte=at
        )
