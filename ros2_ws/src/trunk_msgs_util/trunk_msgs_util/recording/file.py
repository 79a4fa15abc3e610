"""`RecordingFile`: one MCAP file, scanned once: where its messages are, and its metadata."""

from __future__ import annotations

import hashlib
import struct
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema, Statistics

from .bag_folder import LONGEST_HEAD, other_format
from .blocks import (
    BLOCKS,
    ChecksumError,
    DamageError,
    Record,
    TrailingError,
    content_of,
    is_known,
    read_block,
    records,
    visit,
)
from .digests import DIGESTS, END, PROVENANCE
from .limits import MAX_CHANNELS, MAX_METADATA, MAX_NAME, Budget, LimitError
from .messages import MAGIC
from .topic import STAMPED, RecordingError, Topic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from typing import BinaryIO

    from mcap.data_stream import ReadDataStream

    from .joint_arrays import Integers
    from .messages import Messages
    from .split import Content

_OURS = PROVENANCE[:6].encode()  # what the names of our metadata begin with
_SHORT = 1 << 16  # bytes of others' metadata that are read
_NUMBER = struct.Struct("<H")


@dataclass(frozen=True)
class Block:
    """Where a chunk or a run of messages is, and which channels it contains."""

    offset: int
    end: int
    channels: frozenset[int]


class RecordingFile:
    """One file. Nothing after its first damaged byte counts; ``warning`` names that byte."""

    def __init__(self, path: Path, topics: dict[str, Topic]) -> None:
        """Prepare to scan a file into ``topics``, which may hold those of earlier files."""
        self.path = path
        self.topics = topics
        self.library = ""
        self.profile = ""
        self.metadata: dict[str, dict[str, str]] = {PROVENANCE: {}}
        self.metadata_records: list[tuple[str, dict[str, str]]] = []  # all, in file order
        self.attachments = 0
        self.unknown: set[int] = set()  # kinds of records that were skipped
        self._bodies: dict[tuple[int, int | None], bytes] = {}  # of the first schemas and channels
        self.warning: str | None = None
        self.sound = True  # nothing in it was altered
        self.whole = False  # it was read to its end
        self.data_ended = False  # ... or at least to the end of its data
        self.counts: dict[int, int] = {}  # messages by channel
        self._statistics: Statistics | None = None
        self.channels: dict[int, Channel] = {}
        self.blocks: list[Block] = []
        self.schemas: dict[int, Schema] = {}
        self._numbers: dict[str, list[int]] = {}  # channels by topic
        self._bad: dict[
            int, list[Integers]
        ] = {}  # by block: where messages begin that cannot be read
        self._described_by = 0  # bytes of our metadata

    def scan(
        self,
        progress: Callable[[int], None] = lambda _: None,
        keep: Callable[[int, Content], None] = lambda _at, _content: None,
        follow: Callable[[Record, Content | None], None] = lambda _record, _content: None,
    ) -> None:
        """Read the file; ``progress`` is called with the bytes read, ``keep`` with each block's content.

        ``follow`` is called with every record of the file, and the content of those that are blocks.
        Raises RecordingError and OSError.
        """

        def take_content(content: Content, record: Record) -> None:
            self.take_content(content, record)
            keep(record.offset, content)
            follow(record, content)

        size = size_of(self.path)
        budget = Budget(size)
        with self.path.open("rb") as file:
            check_magic(self.path, file, size)
            try:
                for record in records(file, size):
                    visit(record, budget, take_content, self.take_record)
                    if record.opcode not in BLOCKS:
                        follow(record, None)
                    progress(record.end)
            except DamageError as error:
                self.warning = str(error)
                self.whole = isinstance(error, ChecksumError | TrailingError)
                self.sound = not isinstance(error, ChecksumError)
            else:
                self.whole = True
        if self.whole and self._statistics is not None:
            miscount = miscounted(self._statistics, self.counts)
            self.sound, self.warning = self.sound and not miscount, self.warning or miscount or None

    def take_record(self, record: Record) -> None:
        """Process a record without messages. Raises whatever mcap raises."""
        if record.opcode == Opcode.HEADER:
            header = Header.read(record.stream)
            self.profile, self.library = header.profile, header.library
        elif record.opcode == Opcode.SCHEMA:
            if self._is_new(record, self.schemas, Schema.read):
                self.take_described(Schema.read(record.stream))
        elif record.opcode == Opcode.CHANNEL:
            if self._is_new(record, self.channels, Channel.read):
                self.take_described(Channel.read(record.stream))
        elif record.opcode == Opcode.METADATA and record.body[4:10] != _OURS:
            self.metadata_records.append(others_metadata(record))
        elif record.opcode == Opcode.METADATA:
            self._described_by += len(record.body)
            if self._described_by > MAX_METADATA:
                raise LimitError(f"more than {MAX_METADATA} bytes of metadata")
            metadata = Metadata.read(record.stream)
            self.metadata_records.append((metadata.name, metadata.metadata))
            if metadata.name == PROVENANCE:
                self.metadata[PROVENANCE].update(metadata.metadata)
            elif metadata.name in (DIGESTS, END):
                self.metadata[metadata.name] = metadata.metadata
        elif record.opcode == Opcode.ATTACHMENT:
            self.attachments += 1
        elif record.opcode == Opcode.DATA_END:
            self.data_ended = True
        elif record.opcode == Opcode.STATISTICS:
            self._statistics = Statistics.read(record.stream)
        elif not is_known(record.opcode):
            self.unknown.add(record.opcode)

    def _is_new(
        self, record: Record, known: Mapping[int, object], read: Callable[[ReadDataStream], object]
    ) -> bool:
        """Return True for a schema or channel that was not described before.

        Raises ValueError if it was described differently: other readers may take the later description.
        """
        number = numbered(record)
        if number not in known:
            self._bodies[record.opcode, number] = record.body
            return True
        same = self._bodies.get((record.opcode, number)) == record.body
        if not same and read(record.stream) != known.get(number or 0):
            raise ValueError(f"number {number} was described differently before")
        return False

    def take_described(self, item: Schema | Channel) -> None:
        """Process a schema or a channel; the first with a given number counts. Raises LimitError."""
        if isinstance(item, Schema):
            check_schema_limits(len(self.schemas), item)
            self.schemas.setdefault(item.id, item)
        elif item.id not in self.channels:
            check_schema_limits(max(len(self.channels), len(self.topics)), item)
            self.channels[item.id] = item
            self._numbers.setdefault(item.topic, []).append(item.id)
            described = self.schemas.get(item.schema_id)
            topic = self.topics.setdefault(
                item.topic, Topic(described.name if described else "", item.message_encoding)
            )
            if topic.type in STAMPED and topic.is_read() and topic.unreadable.limit is None:
                topic.unreadable.limit = topic.is_read()

    def take_content(self, content: Content, record: Record) -> None:
        """Count a block's messages. Raises DamageError for unknown channels."""
        if not content.channels.keys() <= self.channels.keys():
            raise DamageError(
                f"the record at byte {record.offset} has messages of an unknown channel"
            )
        for number, messages_of in content.channels.items():
            self.counts[number] = self.counts.get(number, 0) + len(messages_of)
        for topic, channels in self.by_topic(content.channels).items():
            messages = content.messages(channels)
            if messages is not None:
                bad = self.topics[topic].take(messages)
                self.leave_out(record.offset, messages, bad)
        self.blocks.append(Block(record.offset, record.end, frozenset(content.channels)))

    def numbers(self, topic: str) -> list[int]:
        """Return the channels of a topic."""
        return self._numbers.get(topic, [])

    def leave_out(self, block: int, messages: Messages, rows: list[int]) -> None:
        """Note which messages of the block at this byte cannot be read."""
        if rows:
            self._bad.setdefault(block, []).append(messages.start[rows])

    def readable(self, block: int, messages: Messages) -> Messages:
        """Return the messages of the block at this byte that can be read."""
        if block not in self._bad:
            return messages
        bad = np.isin(messages.start, np.concatenate(self._bad[block]))
        return messages.without(np.flatnonzero(bad).tolist())

    def type_of(self, channel: int) -> str:
        """Return the message type of a channel."""
        schema = self.schemas.get(self.channels[channel].schema_id)
        return schema.name if schema else ""

    def by_topic(self, channels: Iterable[int]) -> dict[str, list[int]]:
        """Return the channels in a block by their topics."""
        numbers: dict[str, list[int]] = {}
        for number in channels:
            numbers.setdefault(self.channels[number].topic, []).append(number)
        return numbers

    def content(self, file: BinaryIO, block: Block) -> Content:
        """Return a block's content, read again. Raises RecordingError if the file has changed."""
        try:
            return content_of(read_block(file, block.offset, block.end))
        except DamageError as error:
            raise RecordingError(
                f"{self.path} has changed while it was being read: {error}"
            ) from None


def size_of(path: Path) -> int:
    """Return a file's size. Raises RecordingError for what is not a file, and OSError."""
    if not path.is_file() and path.exists():
        raise RecordingError(f"{path} is not a regular file: give a recording of a run")
    return path.stat().st_size


def check_magic(path: Path, file: BinaryIO, size: int) -> None:
    """Read past the magic. Raises RecordingError if it is missing."""
    if size == 0:
        raise RecordingError(f"{path} is empty: nothing was recorded; record the run again")
    head = file.read(len(MAGIC))
    if head != MAGIC:
        kind = other_format(path, head + file.read(LONGEST_HEAD - len(head)))
        raise RecordingError(
            f"{path} is {kind}"
            if kind
            else f"{path} is not an MCAP file: give a recording of a run"
        )


def numbered(record: Record) -> int | None:
    """Return the number with which a schema's or a channel's record begins; None without one."""
    return _NUMBER.unpack_from(record.body)[0] if len(record.body) >= _NUMBER.size else None


def others_metadata(record: Record) -> tuple[str, dict[str, str]]:
    """Return a metadata record that is not ours; only its digest if it is large or malformed."""
    if len(record.body) <= _SHORT:
        with suppress(Exception):  # whatever mcap may raise: nothing in it is needed
            metadata = Metadata.read(record.stream)
            return metadata.name, metadata.metadata
    return "", {"blake2b": hashlib.blake2b(record.body, digest_size=32).hexdigest()}


def check_schema_limits(count: int, item: Schema | Channel) -> None:
    """Raise LimitError for a schema or channel after so many others, or with too long a name."""
    kind, name = ("schema", item.name) if isinstance(item, Schema) else ("topic", item.topic)
    if count >= MAX_CHANNELS:
        raise LimitError(f"more than {MAX_CHANNELS} {kind}s")
    if len(name) > MAX_NAME:
        raise LimitError(
            f"the name of a {kind} has {len(name)} characters: at most {MAX_NAME} are read"
        )


def miscounted(statistics: Statistics, counts: Mapping[int, int]) -> str:
    """Return how statistics differ from a file's messages by channel; empty if they agree."""
    counted = {channel: n for channel, n in statistics.channel_message_counts.items() if n}
    total = sum(counts.values())
    if statistics.message_count == total and counted in ({}, counts):
        return ""
    return (
        f"statistics count {statistics.message_count} messages, there are {total}, "
        "or they are on other channels"
    )
