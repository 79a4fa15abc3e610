"""MCAP files written record by record, by the library's writer, or as a copy of a recording with a change."""

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Header, McapRecord, Schema
from mcap.writer import CompressionType, IndexType, Writer

from trunk_core import topics
from trunk_core.units import NANOSECONDS
from trunk_recording import schemas
from trunk_recording.digests import DIGESTS, RunningDigests
from trunk_recording.reader import Recording
from trunk_recording.summary import Summary, read_summary
from trunk_recording.writer import END, PROVENANCE, RECORD, BagSummary, TopicCount, summary_record

MAGIC = b"\x89MCAP0\r\n"
HEAD, MESSAGE_HEAD = struct.Struct("<BQ"), struct.Struct("<BQHIQQ")
COMPRESSIONS = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}


def stamp_of(time: Any) -> int:
    """Return a Time message as ns."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


# Records.


def raw(opcode: int, body: bytes = b"", length: int | None = None) -> bytes:
    """Return a record of any kind; ``length``: what it claims."""
    return HEAD.pack(opcode, len(body) if length is None else length) + body


def record(*records: McapRecord) -> bytes:
    """Return records as they are in a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def schema(number: int, name: str, data: bytes = b"") -> bytes:
    return record(Schema(number, data, "ros2msg", name))


def channel(number: int, topic: str, schema_number: int = 1) -> bytes:
    return record(Channel(number, topic, "cdr", {}, schema_number))


def message(channel_number: int, log_ns: int, data: bytes) -> bytes:
    """Return a message record; faster than the library, since some files have a million."""
    size = MESSAGE_HEAD.size - HEAD.size + len(data)
    return MESSAGE_HEAD.pack(Opcode.MESSAGE, size, channel_number, 0, log_ns, log_ns) + data


def chunk(
    data: bytes,
    *,
    size: int | None = None,
    compression: str = "zstd",
    packed: bytes | None = None,
    crc: int = 0,
) -> bytes:
    """Return a chunk of some records; ``size``: what it claims, ``packed``: what it holds instead."""
    if packed is None:
        compress = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}
        packed = compress.get(compression, bytes)(data)
    return record(Chunk(compression, packed, 0, 0, crc, len(data) if size is None else size))


def zstd_frame_that_claims(size: int) -> bytes:
    """Return a whole Zstandard frame: magic, a single segment of 8 bytes' size, one raw block."""
    return struct.pack("<IBQ", 0xFD2FB528, 0b1110_0000, size) + b"\x01\x00\x00"


def records_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (kind, start, end) of a whole file's records."""
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = HEAD.unpack_from(data, at)
        yield opcode, at, at + HEAD.size + length
        at += HEAD.size + length


# Files of records.


def start(library: str = "foreign") -> bytes:
    """Return how a file begins."""
    return MAGIC + record(Header("ros2", library))


def finish(data: bytes, summary: bytes = b"", at: int = 0, offsets: int = 0) -> bytes:
    """Return a whole file of some data, magic and header included, and a summary's records.

    ``at``: where its first byte is said to be; ``offsets``: how many bytes the summary's offsets have.
    """
    data += raw(Opcode.DATA_END, struct.pack("<I", zlib.crc32(data)))
    begins = at + len(data) if summary else 0
    footer = record(Footer(begins, begins + len(summary) - offsets if offsets else 0, 0))[:-4]
    return data + summary + footer + struct.pack("<I", zlib.crc32(summary + footer)) + MAGIC


def write_records(path: Path, *parts: bytes, library: str = "foreign") -> Path:
    """Write a file without a summary, whose data are these records."""
    path.write_bytes(finish(start(library) + b"".join(parts)))
    return path


def data_of(whole: bytes) -> bytes:
    """Return a file up to its data's end: magic, header, data."""
    return whole[: next(at for opcode, at, _ in records_of(whole) if opcode == Opcode.DATA_END)]


def summary_of(path: Path) -> Summary:
    """Return a file's summary."""
    with path.open("rb") as file:
        found = read_summary(file, path.stat().st_size)
    assert found is not None
    return found


def summary_records(summary: Summary) -> bytes:
    """Return a summary as it is in a file."""
    counts = [summary.statistics] if summary.statistics else []
    described = (*summary.schemas, *summary.channels, *counts)
    return record(*described, *summary.metadata, *summary.attachments, *summary.chunks)


def reindexed(
    source: Path, target: Path, edit: Callable[[Summary], object], more: bytes = b""
) -> Path:
    """Write a recording anew: its data with ``more`` after them, its summary edited, checksums right."""
    summary = summary_of(source)
    edit(summary)
    target.write_bytes(finish(data_of(source.read_bytes()) + more, summary_records(summary)))
    return target


def moved(index: ChunkIndex, by: int) -> ChunkIndex:
    """Return a chunk's index with its places moved by so many bytes."""
    places = {number: at + by for number, at in index.message_index_offsets.items()}
    begins = index.chunk_start_offset + by
    return replace(index, chunk_start_offset=begins, message_index_offsets=places)


# Files by the library's writer.


def write_mcap(
    path: Path,
    messages,
    *,
    compression="zstd",
    library="foreign",
    encoding="cdr",
    first=(),
    **options,
) -> Path:
    """Write (topic, log time, CDR) of JointState topics; options are those of mcap's writer.

    ``first``: metadata records, (name, values), that come before the messages.
    """
    options = {"chunk_size": 4096, "index_types": IndexType.ALL, **options}
    with path.open("wb") as file:
        writer = Writer(file, compression=COMPRESSIONS[compression], **options)
        writer.start("ros2", library)
        for name, values in first:
            writer.add_metadata(name, values)
        text = schemas.definition(topics.JOINT_STATE_TYPE)
        kind = writer.register_schema(topics.JOINT_STATE_TYPE, "ros2msg", text)
        channels: dict[str, int] = {}
        for topic, log_time_ns, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, encoding, kind)
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns)
        writer.finish()
    return path


# Recordings edited; their digests are kept, made anew or left out.

KEPT, ANEW, NONE = "kept", "anew", "none"


@dataclass
class Content:
    """Everything in a recording that can be edited.

    A message is a list: topic, log time, bytes, publish time, sequence. A channel's key is its topic.
    """

    profile: str
    library: str
    messages: list[list]
    metadata: list[tuple[str, dict[str, str]]]
    channels: dict[str, Channel]
    schemas: dict[int, Schema]
    attachments: list[tuple[str, bytes]] = field(default_factory=list)
    summed_up: dict[str, str] = field(default_factory=dict)  # the summary as it was

    def copy(self):
        """Return a copy whose parts can be changed."""
        return replace(
            self,
            messages=[list(message) for message in self.messages],
            metadata=[(name, dict(values)) for name, values in self.metadata],
            channels=dict(self.channels),
            schemas=dict(self.schemas),
            attachments=list(self.attachments),
        )

    def of(self, topic):
        """Return the messages of a topic."""
        return [message for message in self.messages if message[0] == topic]

    def values(self, name):
        """Return the values of a metadata record."""
        return next(values for told, values in self.metadata if told == name)


def content(source: Path) -> Content:
    """Return what is in a recording."""
    with source.open("rb") as file:
        reader = make_reader(file)
        header, summary = reader.get_header(), reader.get_summary()
        messages = [
            [channel.topic, m.log_time, m.data, m.publish_time, m.sequence]
            for _, channel, m in reader.iter_messages(log_time_order=False)
        ]
        metadata = [(m.name, dict(m.metadata)) for m in reader.iter_metadata()]
    channels = {channel.topic: channel for channel in summary.channels.values()}
    found = Content(
        header.profile, header.library, messages, metadata, channels, dict(summary.schemas)
    )
    found.summed_up = dict(next((values for name, values in metadata if name == RECORD), {}))
    return found


def sum_up(found: Content) -> None:
    """Make the summary fit the messages again, as a forger would, unless the edit was to the summary."""
    counts = Counter(message[0] for message in found.messages)
    times = [message[1] for message in found.messages] or [0]
    told = []
    for topic, channel in found.channels.items():
        kind = found.schemas.get(channel.schema_id)
        told.append(TopicCount(channel.topic, kind.name if kind else "", counts[topic]))
    for name, values in found.metadata:
        if name == RECORD and values == found.summed_up:
            with suppress(ValueError):  # there is no such type
                values |= summary_record(BagSummary(tuple(told), min(times), max(times)))


def write(found: Content, path: Path, digests: str = KEPT) -> Recording:
    """Write a recording (`write_file`) and open it."""
    write_file(found, path, digests)
    return Recording.open(path)


def write_file(found: Content, path: Path, digests: str = KEPT, **options) -> None:
    """Write a recording; its digests are `KEPT` as they were, written `ANEW`, or left out (`NONE`).

    Options are those of mcap's writer; as the recorder does, it writes a checksum of the data.
    """
    if digests == ANEW:
        sum_up(found)
    running = RunningDigests()
    running.header(found.profile, found.library)
    with path.open("wb") as file:
        writer = Writer(file, **{"enable_data_crcs": True, **options})
        writer.start(found.profile, found.library)
        numbers_of_schemas = {
            number: writer.register_schema(kind.name, kind.encoding, kind.data)
            for number, kind in found.schemas.items()
        }
        numbers = {}
        for topic, channel in found.channels.items():
            kind = numbers_of_schemas.get(channel.schema_id, 0)
            numbers[topic] = writer.register_channel(
                channel.topic, channel.message_encoding, kind, channel.metadata
            )
            written = Channel(
                numbers[topic], channel.topic, channel.message_encoding, channel.metadata, kind
            )
            running.channel(written, found.schemas.get(channel.schema_id))
        records = [
            entry
            for entry in found.metadata
            if entry[0] not in (DIGESTS, END) and not entry[0].startswith("late ")
        ]
        last = [entry for entry in found.metadata if entry not in records and entry[0] != DIGESTS]
        for name, values in records:
            writer.add_metadata(name, values)
            running.metadata(name, values)
        for topic, log_time, data, publish_time, sequence in found.messages:
            number, size = numbers[topic], MESSAGE_HEAD.size - HEAD.size + len(data)
            writer.add_message(number, log_time, data, publish_time, sequence)
            running.heads(
                MESSAGE_HEAD.pack(Opcode.MESSAGE, size, number, sequence, log_time, publish_time)
            )
            running.messages(found.channels[topic].topic, data)
        for name, data in found.attachments:
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
            running.attachment()
        writer.flush()
        for name, values in last:
            writer.add_metadata(name, values)
            running.metadata(name, values)
        for name, values in found.metadata:
            if name == DIGESTS and digests == KEPT:
                writer.add_metadata(name, values)
        if digests == ANEW:
            writer.add_metadata(DIGESTS, running.values())
        writer.finish()


def copied(source, path, edit=lambda messages: None, digests=KEPT, end=True, provenance=None):
    """Write ``source`` again with ``edit`` applied to its messages.

    ``end``: whether it is said to have ended, or values of that record to replace; ``provenance``: values of
    the run's origin to replace.
    """
    found = content(source)
    edit(found.messages)
    found.values(PROVENANCE).update(provenance or {})
    if isinstance(end, Mapping):
        found.values(END).update(end)
    elif not end:
        found.metadata = [entry for entry in found.metadata if entry[0] != END]
    return write(found, path, digests)


def each(change: Callable[[str, bytes, int], bytes | None]):
    """Return an edit that gives each message its bytes, ``change(topic, CDR, index in topic)``.

    Topics are relative; None leaves the message out.
    """

    def edit(messages: list[list]) -> None:
        seen: Counter[str] = Counter()
        for message in messages:
            topic = message[0].removeprefix("/")
            message[2] = change(topic, message[2], seen[topic])
            seen[topic] += 1
        messages[:] = [message for message in messages if message[2] is not None]

    return edit
