"""Reads only a file's summary and indexes: instant, whatever its length; nothing is checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Schema

from .blocks import Record, content_of, read_block, records
from .file import Block, RecordingFile
from .limits import Budget
from .messages import HEAD
from .split import Content
from .summary import Summary, message_indexes, read_summary
from .topic import Topic

if TYPE_CHECKING:
    from pathlib import Path


def glance(path: Path, topics: dict[str, Topic]) -> RecordingFile | None:
    """Return the file as its summary describes it, with ``topics`` filled as by a scan.

    A topic's size is that of the messages in its first and last chunk if these are all equal, or
    else 0. None if the summary is incomplete or does not fit the file.
    """
    found: dict[str, Topic] = {}
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            summary = read_summary(file, size)
            if summary is None or not _fits(summary):
                return None
            recording = RecordingFile(path, found)
            recording.whole = True
            file.seek(8)
            for record in records(file, size):
                recording.take_record(record)
                break  # the header
            _describe(recording, summary, file)
            _measure(recording, summary, file)
    except Exception:  # whatever a damaged summary may raise: the file is scanned instead
        return None
    if any(name in topics and topics[name].count for name in found):
        return None  # topics continue from an earlier file: their gaps are not known here
    topics.update(found)
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
