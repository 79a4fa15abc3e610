"""`RecordingFile`: one MCAP file, scanned once: where its messages are, and its metadata."""

from __future__ import annotations

import hashlib
import struct
from contextlib import suppress
from dataclasses import dataclass, field
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
    reached,
    read_block,
    records,
)
from .digests import DIGESTS
from .faults import Faults, JointCheck
from .limits import MAX_CHANNELS, MAX_METADATA, MAX_NAME, Budget, LimitError
from .writer import END, PROVENANCE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from typing import BinaryIO

    from mcap.data_stream import ReadDataStream

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


_OURS = PROVENANCE[:6].encode()  # what the names of our metadata begin with
_SHORT = 4096  # bytes of others' metadata that are read
_NUMBER = struct.Struct("<H")


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
    faults: Faults = field(default_factory=Faults)
    _check: JointCheck = field(default_factory=JointCheck, repr=False, compare=False)

    @property
    def readable(self) -> int:
        """How many of the messages can be read, as far as they were looked at."""
        return 0 if self.faults.limit is not None else self.count - self.faults.count

    def take(self, messages: Messages) -> list[int]:
        """Count some messages that follow the earlier ones; return the rows that cannot be read."""
        bad = self._bad(messages)
        for row, why in bad:
            self.faults.add(self.count + row, int(messages.log_time_ns[row]), why)
        rows = [row for row, _ in bad]
        good = messages.without(rows) if rows else messages
        self.count += len(messages)
        self.size += int((messages.end - messages.start).sum())
        if len(good):
            self.take_stamps(good, good)
        self.take_log(messages.log_time_ns)
        return rows

    def _bad(self, messages: Messages) -> list[tuple[int, str]]:
        if self.type != names.JOINT_STATE_TYPE or self.faults.limit is not None:
            return []
        try:
            return self._check.bad(messages)
        except LimitError as error:
            self.faults.limit = str(error)
            return []

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
        self._bodies: dict[tuple[int, int | None], bytes] = {}  # of the first schemas and channels
        self.warning: str | None = None
        self.sound = True  # nothing in it was altered
        self.channels: dict[int, Channel] = {}
        self.blocks: list[Block] = []
        self.schemas: dict[int, Schema] = {}
        self._numbers: dict[str, list[int]] = {}  # channels by topic
        self._bad: dict[
            int, list[Integers]
        ] = {}  # by block: where messages begin that cannot be read
        self._described_by = 0  # bytes of our metadata

    def scan(self, progress: Callable[[int], None] = lambda _: None) -> None:
        """Read the file; ``progress`` is called with the bytes read. Raises RecordingError and OSError."""
        size = size_of(self.path)
        budget = Budget(size)
        with self.path.open("rb") as file:
            check_magic(self.path, file, size)
            try:
                for record in records(file, size):
                    self._take(record, budget)
                    progress(record.end)
            except ChecksumError as error:
                self.sound = False
                self.warning = str(error)
            except DamageError as error:
                self.warning = str(error)

    def _take(self, record: Record, budget: Budget) -> None:
        if record.opcode in BLOCKS:
            content = content_of(record, budget)
            for opcode, body in content.others:
                self._take_other(Record(record.offset, opcode, body, record.end))
            self.take_content(content, record)
        else:
            self._take_other(record)

    def _take_other(self, record: Record) -> None:
        try:
            self.take_record(record)
        except LimitError as error:
            raise reached(record, error) from None
        except Exception as error:  # whatever mcap may raise on a damaged record
            raise damaged(record, error) from None

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
            self.metadata_records.append(_of_others(record))
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

    def _is_new(
        self, record: Record, known: Mapping[int, object], read: Callable[[ReadDataStream], object]
    ) -> bool:
        """Return True for a schema or channel that was not described before.

        Raises ValueError if it was, but otherwise: other readers may take the later one.
        """
        number = numbered(record)
        if number not in known:
            self._bodies[record.opcode, number] = record.body
            return True
        same = self._bodies.get((record.opcode, number)) == record.body
        if not same and read(record.stream) != known.get(number or 0):
            raise ValueError(f"number {number} was described otherwise before")
        return False

    def take_described(self, item: Schema | Channel) -> None:
        """Process a schema or a channel; the first with a given number counts. Raises LimitError."""
        if isinstance(item, Schema):
            check_described(len(self.schemas), item)
            self.schemas.setdefault(item.id, item)
        elif item.id not in self.channels:
            check_described(max(len(self.channels), len(self.topics)), item)
            self.channels[item.id] = item
            self._numbers.setdefault(item.topic, []).append(item.id)
            described = self.schemas.get(item.schema_id)
            self.topics.setdefault(item.topic, Topic(described.name if described else ""))

    def take_content(self, content: Content, record: Record) -> None:
        """Count a block's messages. Raises DamageError for unknown channels."""
        if not content.channels.keys() <= self.channels.keys():
            raise DamageError(
                f"the record at byte {record.offset} has messages of an unknown channel"
            )
        for topic, channels in self.by_topic(content.channels).items():
            messages = content.messages(channels)
            if messages is not None:
                bad = self.topics[topic].take(messages)
                if bad:
                    self._bad.setdefault(record.offset, []).append(messages.start[bad])
        self.blocks.append(Block(record.offset, record.end, frozenset(content.channels)))

    def numbers(self, topic: str) -> list[int]:
        """Return the channels of a topic."""
        return self._numbers.get(topic, [])

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


def size_of(path: Path) -> int:
    """Return a file's size. Raises RecordingError for what is not a file, and OSError."""
    if not path.is_file() and path.exists():
        raise RecordingError(f"{path} is not a regular file: give a recording of a run")
    return path.stat().st_size


def numbered(record: Record) -> int | None:
    """Return the number with which a schema's or a channel's record begins; None without one."""
    return _NUMBER.unpack_from(record.body)[0] if len(record.body) >= _NUMBER.size else None


def _of_others(record: Record) -> tuple[str, dict[str, str]]:
    """Return a metadata record that is not ours; its digest alone where it is large or makes no sense."""
    if len(record.body) <= _SHORT:
        with suppress(Exception):  # whatever mcap may raise: nothing in it is needed
            metadata = Metadata.read(record.stream)
            return metadata.name, metadata.metadata
    return "", {"blake2b": hashlib.blake2b(record.body, digest_size=32).hexdigest()}


def check_described(count: int, item: Schema | Channel) -> None:
    """Raise LimitError for a schema or channel after so many others, or with too long a name."""
    what, name = ("schema", item.name) if isinstance(item, Schema) else ("topic", item.topic)
    if count >= MAX_CHANNELS:
        raise LimitError(f"more than {MAX_CHANNELS} {what}s")
    if len(name) > MAX_NAME:
        raise LimitError(f"the name of a {what} has {len(name)} letters, {MAX_NAME} are read")


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
