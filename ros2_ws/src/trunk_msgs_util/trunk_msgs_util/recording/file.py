"""`RecordingFile`: one MCAP file, scanned once: where its messages are, and its metadata."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from .. import topics as names
from ..errors import TrunkError
from ..units import NANOSECONDS
from .blocks import (
    BLOCKS,
    MAGIC,
    ChecksumError,
    DamageError,
    Record,
    content_of,
    damaged,
    read_block,
    records,
)
from .digests import DIGESTS
from .writer import END, PROVENANCE

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import BinaryIO

    from .joint_arrays import Integers
    from .messages import Messages
    from .split import Content

# These types begin with a stamp, right after the encapsulation header.
STAMPED = (
    names.JOINT_STATE_TYPE,
    names.PARAMETER_EVENT_TYPE,
    names.DIAGNOSTIC_ARRAY_TYPE,
    names.CLOCK_TYPE,
)


class RecordingError(TrunkError):
    """The file cannot be used as a recording: one line that names it and says what to do."""


@dataclass
class Topic:
    """What is recorded on a topic; stamps are the headers', or else the log times."""

    type: str
    count: int = 0
    first_stamp_ns: int | None = None
    last_stamp_ns: int | None = None
    size: int = 0  # encoded bytes
    last_log_ns: int | None = None
    longest_gap_ns: int = 0  # between the log times of consecutive messages

    def take(self, messages: Messages) -> None:
        """Count some messages that follow the earlier ones."""
        self.count += len(messages)
        self.size += int((messages.end - messages.start).sum())
        self.take_stamps(messages, messages)
        self.take_log(messages.log_time_ns)

    def take_stamps(self, first: Messages, last: Messages) -> None:
        """Take account of the first stamp of some messages, and of the last stamp of others."""
        begin, end = (
            stamp_at(messages.data, int(messages.start[i]))
            if self.type in STAMPED
            else int(messages.log_time_ns[i])
            for messages, i in ((first, 0), (last, -1))
        )
        if self.first_stamp_ns is None:
            self.first_stamp_ns = begin
        self.last_stamp_ns = end

    def take_log(self, log_time_ns: Integers) -> None:
        """Take account of the log times of one or more messages that follow the earlier ones."""
        first, last = int(log_time_ns[0]), int(log_time_ns[-1])
        if self.last_log_ns is not None:
            self.longest_gap_ns = max(self.longest_gap_ns, first - self.last_log_ns)
        if len(log_time_ns) > 1:
            self.longest_gap_ns = max(self.longest_gap_ns, int(np.diff(log_time_ns).max()))
        self.last_log_ns = last


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
        self.warning: str | None = None
        self.sound = True  # nothing in it was altered
        self.channels: dict[int, Channel] = {}
        self.blocks: list[Block] = []
        self.schemas: dict[int, Schema] = {}

    def scan(self, progress: Callable[[int], None] = lambda _: None) -> None:
        """Read the file; ``progress`` is called with the bytes read. Raises RecordingError and OSError."""
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            check_magic(self.path, file, size)
            try:
                for record in records(file, size):
                    self._take(record)
                    progress(record.end)
            except ChecksumError as error:
                self.sound = False
                self.warning = str(error)
            except DamageError as error:
                self.warning = str(error)

    def _take(self, record: Record) -> None:
        if record.opcode in BLOCKS:
            self._take_block(record)
            return
        try:
            self.take_record(record)
        except Exception as error:  # whatever mcap may raise on a damaged record
            raise damaged(record, error) from None

    def take_record(self, record: Record) -> None:
        """Process a record without messages. Raises whatever mcap raises."""
        if record.opcode == Opcode.HEADER:
            header = Header.read(record.stream)
            self.profile, self.library = header.profile, header.library
        elif record.opcode == Opcode.SCHEMA:
            self.take_described(Schema.read(record.stream))
        elif record.opcode == Opcode.CHANNEL:
            self.take_described(Channel.read(record.stream))
        elif record.opcode == Opcode.METADATA:
            metadata = Metadata.read(record.stream)
            self.metadata_records.append((metadata.name, metadata.metadata))
            if metadata.name == PROVENANCE:
                self.metadata[PROVENANCE].update(metadata.metadata)
            elif metadata.name in (DIGESTS, END):
                self.metadata[metadata.name] = metadata.metadata
        elif record.opcode == Opcode.ATTACHMENT:
            self.attachments += 1

    def take_described(self, item: Schema | Channel) -> None:
        """Process a schema or a channel. Raises ValueError if its number has been described otherwise."""
        known = (self.schemas if isinstance(item, Schema) else self.channels).get(item.id)
        if known is not None and known != item:  # other readers may take the later one
            raise ValueError(f"number {item.id} was described otherwise before")
        if isinstance(item, Schema):
            self.schemas[item.id] = item
        elif known is None:
            self.channels[item.id] = item
            described = self.schemas.get(item.schema_id)
            self.topics.setdefault(item.topic, Topic(described.name if described else ""))

    def _take_block(self, record: Record) -> None:
        content = content_of(record)
        for opcode, body in content.others:
            if opcode not in BLOCKS:
                self._take(Record(record.offset, opcode, body, record.end))
        self.take_content(content, record)

    def take_content(self, content: Content, record: Record) -> None:
        """Count a block's messages. Raises DamageError for unknown channels."""
        if not content.channels.keys() <= self.channels.keys():
            raise DamageError(
                f"the record at byte {record.offset} has messages of an unknown channel"
            )
        for topic, channels in self.by_topic(content.channels).items():
            messages = content.messages(channels)
            if messages is not None:
                self.topics[topic].take(messages)
        self.blocks.append(Block(record.offset, record.end, frozenset(content.channels)))

    def numbers(self, topic: str) -> list[int]:
        """Return the channels of a topic."""
        return [number for number, channel in self.channels.items() if channel.topic == topic]

    def type_of(self, channel: int) -> str:
        """Return the message type of a channel."""
        schema = self.schemas.get(self.channels[channel].schema_id)
        return schema.name if schema else ""

    def by_topic(self, channels: dict[int, Messages]) -> dict[str, list[int]]:
        """Return the channels in a block by their topics."""
        found: dict[str, list[int]] = {}
        for number in channels:
            found.setdefault(self.channels[number].topic, []).append(number)
        return found

    def content(self, file: BinaryIO, block: Block) -> Content:
        """Return a block's content, read again. Raises RecordingError if the file has changed."""
        try:
            return content_of(read_block(file, block.offset, block.end))
        except DamageError as error:
            raise RecordingError(f"{self.path} has changed while it was read: {error}") from None


def check_magic(path: Path, file: BinaryIO, size: int) -> None:
    """Read past the magic. Raises RecordingError if it is missing."""
    if size == 0:
        raise RecordingError(f"{path} is empty: nothing was recorded; record the run again")
    if file.read(len(MAGIC)) != MAGIC:
        raise RecordingError(f"{path} is not an MCAP file: give a recording of a run")


def stamp_at(data: bytes, start: int) -> int:
    """Return the stamp in ns of a CDR message whose first field is one."""
    order: Literal["little", "big"] = "little" if data[start + 1 : start + 2] == b"\x01" else "big"
    sec = int.from_bytes(data[start + 4 : start + 8], order, signed=True)
    return sec * NANOSECONDS + int.from_bytes(data[start + 8 : start + 12], order)
