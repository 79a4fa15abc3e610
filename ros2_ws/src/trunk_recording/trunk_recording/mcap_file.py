"""`McapFile`: one MCAP file, read once, record by record, up to the first damage.

What holds messages is a block: a chunk, or a run of messages outside chunks. The same walk counts what is
recorded on each `Topic` and says what of it cannot be read, finds what is wrong with the file's structure,
and notes what an index has to say of it (`summary`).
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Header, Metadata, Schema, Statistics

from trunk_core import topics as names
from trunk_core.errors import RecordingError
from trunk_core.units import NANOSECONDS, seconds

from .bag_folder import not_mcap
from .digests import (
    DIGESTS,
    END,
    NOWHERE,
    PROVENANCE,
    Content,
    chunk_head,
    chunk_records,
    record_offsets,
    split,
)
from .joint_table import UnreadableError, pieces
from .messages import HEAD, LIMIT, MAGIC, allowed, unaligned

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from trunk_core.arrays import Integers

    from .cdr import JointStateLayout
    from .joint_table import Piece
    from .messages import Messages

    Fill = Callable[[str, Messages, list[Piece]], None]

# These types begin with a stamp, right after the encapsulation header.
STAMPED = (
    names.JOINT_STATE_TYPE,
    names.PARAMETER_EVENT_TYPE,
    names.DIAGNOSTIC_ARRAY_TYPE,
    names.CLOCK_TYPE,
)


CDR = "cdr"
_STAMP = np.dtype(
    {
        "names": ["order", "sec", "nanosec"],
        "formats": ["u1", "<i4", "<u4"],
        "offsets": [1, 4, 8],
        "itemsize": 12,
    }
)
STAMP_SIZE = _STAMP.itemsize


@dataclass
class Topic:
    """What is recorded on a topic; stamps are the headers', or else the log times.

    First and last are the earliest and the latest: MCAP gives messages no order.
    """

    type: str
    encoding: str = CDR
    count: int = 0
    first_stamp_ns: int | None = None
    last_stamp_ns: int | None = None
    size: int = 0  # encoded bytes
    last_log_ns: int | None = None
    longest_gap_ns: int = 0  # between the log times of consecutive messages, if `ordered`
    ordered: bool = True  # no message was logged before the one that precedes it in the file
    # Of the stamps in the order of the file, where all of them were read:
    rising: bool = field(default=True, compare=False)
    longest_step_ns: int = field(default=0, compare=False)
    overflowing: int = field(default=0, compare=False)  # their nanoseconds make a second or more
    _previous_ns: int | None = field(default=None, repr=False, compare=False)
    finite: bool = field(default=True, compare=False)  # all values of a JointState topic
    unreadable: str = ""  # a message that cannot be read, and why: none is read
    # Of a JointState topic's messages, in the order of the file, each with its frame:
    layouts: dict[JointStateLayout, None] = field(default_factory=dict, repr=False, compare=False)

    @property
    def readable(self) -> int:
        """How many of the messages can be read, as far as they were looked at."""
        return 0 if self.unreadable else self.count

    @property
    def is_uniform(self) -> bool:
        """True if all messages of a JointState topic carry values of the same names."""
        return len({replace(layout, frame_id="") for layout in self.layouts}) < 2

    def is_read(self) -> str:
        """Return why messages of this topic are not read by their type; empty if they are."""
        return "" if self.encoding in (CDR, "") else f"encoded as {self.encoding}, only cdr is read"

    def refuse(self, number: int, log_time_ns: int, why: str) -> None:
        """Note that a message cannot be read, the topic's ``number``, counted from 0."""
        logged = f", logged at {seconds(log_time_ns):.9f} s" if log_time_ns >= 0 else ""
        self.unreadable = self.unreadable or f"message {number}{logged}: {' '.join(why.split())}"

    def take(self, messages: Messages) -> list[Piece] | None:
        """Count some messages that follow the earlier ones; return a JointState topic's by layouts.

        None if they are not to be read.
        """
        parts, log = None, messages.log_time_ns
        if (log < 0).any():
            row = int(np.argmax(log < 0))
            self.refuse(self.count + row, -1, "its log time is beyond the year 2262")
        if self.type == names.JOINT_STATE_TYPE and not (self.unreadable or self.is_read()):
            try:
                parts = pieces(messages)
                self.layouts |= dict.fromkeys(part.layout for part in parts)
                self.finite = self.finite and all(part.is_finite() for part in parts)
            except UnreadableError as error:
                self.refuse(self.count + error.row, int(log[error.row]), str(error))
        self.count += len(messages)
        self.size += int((messages.end - messages.start).sum())
        if len(messages) and (self.is_read() or not self.unreadable):
            self.take_stamps(messages)
            self.take_log(log)
        return None if self.unreadable else parts

    def take_stamps(self, messages: Messages) -> None:
        """Take account of the stamps of one or more messages."""
        stamps = messages.log_time_ns
        if self.type in STAMPED and not self.is_read():
            sec, nanosec = fields_of(messages)
            stamps = sec * NANOSECONDS + nanosec
            self.overflowing += int(np.count_nonzero(nanosec >= NANOSECONDS))
        if len(stamps):
            before = [] if self._previous_ns is None else [self._previous_ns]
            steps = np.diff(np.append(np.array(before, np.int64), stamps))
            if len(steps):
                self.rising = self.rising and bool(steps.min() > 0)
                self.longest_step_ns = max(self.longest_step_ns, int(steps.max()))
            self._previous_ns = int(stamps[-1])
            first, last = int(stamps.min()), int(stamps.max())
            if self.first_stamp_ns is not None and self.last_stamp_ns is not None:
                first, last = min(first, self.first_stamp_ns), max(last, self.last_stamp_ns)
            self.first_stamp_ns, self.last_stamp_ns = first, last

    def take_log(self, log_time_ns: Integers) -> None:
        """Take account of the log times of one or more messages that follow the earlier ones."""
        before = [] if self.last_log_ns is None else [self.last_log_ns]
        steps = np.diff(np.append(np.array(before, np.int64), log_time_ns))
        if len(steps):
            self.longest_gap_ns = max(self.longest_gap_ns, int(steps.max()))
            self.ordered = self.ordered and bool(steps.min() >= 0)
        self.last_log_ns = int(log_time_ns[-1])


def fields_of(messages: Messages) -> tuple[Integers, Integers]:
    """Return the stamps of CDR messages that begin with one, where they are long enough: s and ns."""
    start = messages.start[messages.end - messages.start >= STAMP_SIZE]
    fields = unaligned(messages.data, _STAMP)[start]
    little = fields["order"] == 1
    if little.all():  # as almost always
        return fields["sec"].astype(np.int64), fields["nanosec"].astype(np.int64)
    big = fields.view(_STAMP.newbyteorder(">"))
    sec, nanosec = (np.where(little, fields[name], big[name]) for name in ("sec", "nanosec"))
    return sec.astype(np.int64), nanosec.astype(np.int64)


ERROR, WARNING, INFO = "error", "warning", "info"
BLOCKS = (Opcode.CHUNK, Opcode.MESSAGE)

_CRC = struct.Struct("<I")
_CHANNELS = 4096  # of a file, at most, and schemas
_RUN = 1 << 20  # bytes of messages outside chunks that are read at a time, at most
_AHEAD = 1 << 12  # the same, at first: it doubles while nothing else comes
# What comes only after the end of the data; among them it is a damaged record.
_AFTER_DATA = (
    Opcode.FOOTER,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.STATISTICS,
    Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
)
_INDEX_HEAD = struct.Struct("<HI")  # channel, bytes of the entries


OURS = "trunk_msgs_util"  # how the library's name begins in files that must have an end record
_OUR_METADATA = PROVENANCE[:6].encode()  # what the names of our metadata begin with
_NUMBER = struct.Struct("<H")
# Records with maps, in which others may read the first of two equal keys.
_READ: dict[int, Callable[[ReadDataStream], Any]] = {
    Opcode.METADATA: Metadata.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.STATISTICS: Statistics.read,
}


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


class DamageError(ValueError):
    """The file is damaged from some byte on."""


class ChecksumError(DamageError):
    """The file is complete, but something in it was altered."""


class TrailingError(DamageError):
    """The recording is complete, but the file goes on after it: readers from the end see something else."""


class Record(NamedTuple):
    """A record, or a run of messages outside chunks with their headers (``opcode`` is MESSAGE)."""

    offset: int  # in the file; of the chunk, for a record inside one
    opcode: int
    body: bytes  # empty for attachments and kinds that are not known
    end: int
    indexed: Integers = NOWHERE  # where the index behind a chunk says that its messages begin

    @property
    def stream(self) -> ReadDataStream:
        """The stream from which mcap reads a record."""
        return ReadDataStream(BytesIO(self.body))


def name_of(opcode: int) -> str:
    """Return the name of this kind of record, or its number where it has none."""
    return Opcode(opcode).name if is_known(opcode) else f"{opcode:#04x}"


def is_known(opcode: int) -> bool:
    """Return whether MCAP defines this kind of record; private ones and later ones are skipped."""
    return opcode in Opcode._value2member_map_


def records(file: BinaryIO, size: int, start: int = len(MAGIC)) -> Iterator[Record]:
    """Yield the records of a file of ``size`` bytes positioned at ``start``, after its magic.

    From a later ``start`` the data's checksum cannot be checked, and is not.
    Raises DamageError at a record that is cut off or too long to be read, ChecksumError after
    data whose checksum is wrong, and TrailingError if the file goes on after its end.
    """
    crc = zlib.crc32(MAGIC)
    offset = start
    in_data = True
    while offset < size:
        head = file.read(HEAD.size)
        if len(head) < HEAD.size:
            raise DamageError(f"ends at byte {size}, in the header of the record at byte {offset}")
        opcode, length = HEAD.unpack(head)
        end = offset + HEAD.size + length
        if end > size:
            raise DamageError(
                f"ends at byte {size}, inside the {name_of(opcode)} record at byte {offset}"
            )
        if opcode == 0:
            raise DamageError(f"a record of kind 0x00, which is not valid, at byte {offset}")
        if in_data and opcode in _AFTER_DATA:
            raise DamageError(f"a {name_of(opcode)} record among the data, at byte {offset}")
        in_data = in_data and opcode != Opcode.DATA_END
        if opcode == Opcode.ATTACHMENT or not is_known(opcode):
            yield Record(offset, opcode, b"", end)
            crc = _skip(file, length, zlib.crc32(head, crc))
        else:
            if length > LIMIT:
                raise DamageError(
                    f"the {name_of(opcode)} record at byte {offset} claims {length} bytes, "
                    f"more than the {LIMIT} that are read"
                )
            body = file.read(length)
            if opcode == Opcode.MESSAGE:
                body = _run(file, head + body, size - end)
                end = offset + len(body)
                head = b""
            if opcode == Opcode.DATA_END:
                (expected,) = _CRC.unpack(body[:4].ljust(4, b"\x00"))
                if start == len(MAGIC) and expected not in (0, crc):
                    raise ChecksumError(f"the checksum of the first {offset} bytes is wrong")
            crc = zlib.crc32(body, zlib.crc32(head, crc))
            indexed = _indexed(file) if opcode == Opcode.CHUNK else NOWHERE
            yield Record(offset, opcode, body, end, indexed)
        if opcode == Opcode.FOOTER:
            if file.read(len(MAGIC)) != MAGIC:
                raise DamageError(f"ends at byte {size}, without the closing magic at byte {end}")
            if end + len(MAGIC) < size:
                raise TrailingError(
                    f"{size - end - len(MAGIC)} bytes after the end at byte {end + len(MAGIC)}: "
                    "other readers may see another recording"
                )
            return
        offset = end
    raise DamageError(f"ends at byte {size}, without a footer")


def _skip(file: BinaryIO, length: int, crc: int) -> int:
    """Read past some bytes and return the checksum continued over them."""
    while length > 0:
        piece = file.read(min(length, _RUN))
        crc = zlib.crc32(piece, crc)
        length -= max(len(piece), 1)
    return crc


def _indexed(file: BinaryIO) -> Integers:
    """Return the offsets in the message indexes that come next in a file, which is left where it is."""
    start, left = file.tell(), LIMIT
    places: list[Integers] = [NOWHERE]
    while left > 0 and len(head := file.read(HEAD.size + _INDEX_HEAD.size)) > HEAD.size:
        opcode, length = HEAD.unpack_from(head)
        left -= length
        if opcode != Opcode.MESSAGE_INDEX or not _INDEX_HEAD.size <= length <= LIMIT:
            break
        entries = file.read(length - _INDEX_HEAD.size)
        places.append(np.frombuffer(entries, "<i8", len(entries) // 8)[1::2])
    file.seek(start)
    return np.concatenate(places)


def _run(file: BinaryIO, first: bytes, left: int) -> bytes:
    """Return a message record and the whole message records after it, about `_RUN` bytes.

    About as much as what is returned, or `_AHEAD`, may be read ahead and discarded.
    """
    run, ahead = [first], _AHEAD
    while ahead <= _RUN and left:
        data = file.read(min(ahead, left))
        offsets, end = record_offsets(data)
        others = np.flatnonzero(np.frombuffer(data, np.uint8)[offsets] != Opcode.MESSAGE)
        if len(others):
            end = int(offsets[others[0]])
        file.seek(end - len(data), 1)
        run.append(data[:end])
        left -= end
        if len(others) or not end:
            break
        ahead *= 2
    return b"".join(run)


def damaged(record: Record, error: Exception) -> DamageError:
    """Return the error for a record whose body makes no sense."""
    reason = str(error) or type(error).__name__
    return DamageError(
        f"the {name_of(record.opcode)} record at byte {record.offset} is damaged ({reason})"
    )


def content_of(record: Record) -> Content:
    """Return the content of a block. Raises DamageError."""
    try:
        if record.opcode == Opcode.CHUNK:
            return split(chunk_records(record.body), record.indexed)
        return split(record.body)
    except Exception as error:  # whatever a decompressor may raise on damaged bytes
        raise damaged(record, error) from None


def read_block(file: BinaryIO, offset: int, end: int) -> Record:
    """Return a block that `records` has yielded before."""
    file.seek(offset)
    data = file.read(end - offset)
    if data[:1] == bytes([Opcode.CHUNK]):
        return Record(offset, Opcode.CHUNK, data[HEAD.size :], end, _indexed(file))
    return Record(offset, Opcode.MESSAGE, data, end)


@dataclass(frozen=True)
class Block:
    """Where a chunk or a run of messages is, and which channels it contains."""

    offset: int
    end: int
    channels: frozenset[int]


class McapFile:
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
        self.warning: str | None = None
        self.sound = True  # nothing in it was altered
        self.whole = False  # it was read to its end
        self.closed = False  # it is damaged, but ends as a file that was written to its end
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.blocks: list[Block] = []
        # What its structure is, beside what the index says of it.
        self.findings: list[Finding] = []
        self.size = 0  # 0: it was not scanned
        self.end = len(MAGIC)  # of the last record
        self.data_end: int | None = None
        self.counts: dict[int, int] = {}  # messages by channel
        self.outside = 0  # messages outside chunks
        self.span_ns = 0, 0  # of all log times; zeros without messages
        # What an index has to say, in the order of the file:
        self.chunks: dict[int, ChunkIndex] = {}  # by offset
        self.metadata_index: list[tuple[int, int, str]] = []  # offset, length, name
        self.attachment_index: list[tuple[int, int]] = []  # offset, length
        self._last = Content(b"")  # of the last chunk
        self._statistics: Statistics | None = None
        self._bodies: dict[tuple[int, int | None], bytes] = {}  # of the first schemas and channels
        self._numbers: dict[str, list[int]] = {}  # channels by topic
        self._unpacked = 0  # bytes of all blocks

    def scan(
        self,
        progress: Callable[[int], None] = lambda _: None,
        keep: Callable[[int, Content], None] = lambda _at, _content: None,
        fill: Fill | None = None,
    ) -> None:
        """Read the file; ``progress`` is called with the bytes read, ``keep`` with each block's content.

        ``fill`` is called with the messages of JointState topics. Raises RecordingError and OSError.
        """
        self.size = size = size_of(self.path)
        with self.path.open("rb") as file:
            check_magic(self.path, file, size)
            try:
                for record in records(file, size):
                    content = self.take(record, fill)
                    if content is not None:
                        keep(record.offset, content)
                    self.end = record.end
                    progress(record.end)
            except DamageError as error:
                self.warning = str(error)
                self.whole = isinstance(error, ChecksumError | TrailingError)
                self.sound = not isinstance(error, ChecksumError)
                if isinstance(error, TrailingError):
                    self.size = self.end + len(MAGIC)
                self.findings.append(Finding(ERROR, str(error), byte=self.end))
                file.seek(-len(MAGIC), SEEK_END)
                self.closed = file.read() == MAGIC
            else:
                self.whole = True
        counted = self._statistics if self.whole else None
        if counted is not None and (miscount := miscounted(counted, self.counts)):
            self.sound, self.warning = False, self.warning or miscount
            self.findings.append(Finding(ERROR, miscount, byte=self.end))
        self._last = Content(b"")

    @cached_property
    def _allowed(self) -> int:
        return allowed(self.path.stat().st_size)

    def take(self, record: Record, fill: Fill | None = None) -> Content | None:
        """Process a record; return a block's content. Raises DamageError; RecordingError at the limit."""
        content = content_of(record) if record.opcode in BLOCKS else None
        self._unpacked += len(content.data) if content else 0
        if self._unpacked > self._allowed or max(len(self.channels), len(self.schemas)) > _CHANNELS:
            limit = f"more than {self._allowed} bytes unpacked, or {_CHANNELS} channels or schemas"
            raise RecordingError(
                f"{self.path} is too large to be read: {limit}; record shorter runs"
            )
        for opcode, body in content.others if content else [(record.opcode, record.body)]:
            part = Record(record.offset, opcode, body, record.end)
            if content and is_known(opcode) and opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
                raise damaged(record, ValueError(f"a {name_of(opcode)} record in it"))
            try:
                self.take_record(part)
            except Exception as error:  # whatever mcap may raise on a damaged record
                raise damaged(part, error) from None
        self._look_at(record)
        if content is not None:
            self._look_into(record, content)
            self._take_content(content, record, fill)
        return content

    def take_record(self, record: Record) -> None:
        """Process a record without messages. Raises whatever mcap raises."""
        if record.opcode in _READ and not _is_canonical(record):
            text = (
                f"the {name_of(record.opcode)} record has a key twice: others may read it otherwise"
            )
            self.findings.append(Finding(ERROR, text, byte=record.offset))
        if record.opcode == Opcode.HEADER:
            header = Header.read(record.stream)
            self.profile, self.library = header.profile, header.library
        elif record.opcode == Opcode.SCHEMA:
            if self._is_new(record, self.schemas, Schema.read):
                self.take_described(Schema.read(record.stream))
        elif record.opcode == Opcode.CHANNEL:
            if self._is_new(record, self.channels, Channel.read):
                self.take_described(Channel.read(record.stream))
        elif record.opcode == Opcode.METADATA and record.body[4:10] != _OUR_METADATA:
            self.metadata_records.append(others_metadata(record))
        elif record.opcode == Opcode.METADATA:
            metadata = Metadata.read(record.stream)
            self.metadata_records.append((metadata.name, metadata.metadata))
            if metadata.name == PROVENANCE:
                self.metadata[PROVENANCE].update(metadata.metadata)
            elif metadata.name in (DIGESTS, END):
                self.metadata[metadata.name] = metadata.metadata
        elif record.opcode == Opcode.ATTACHMENT:
            self.attachments += 1
        elif record.opcode == Opcode.MESSAGE_INDEX and self.chunks:
            self._take_index(record)
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
        """Process a schema or a channel; the first with a given number counts."""
        if isinstance(item, Schema):
            self.schemas.setdefault(item.id, item)
        elif item.id not in self.channels:
            self.channels[item.id] = item
            self._numbers.setdefault(item.topic, []).append(item.id)
            described = self.schemas.get(item.schema_id)
            topic = self.topics.setdefault(
                item.topic, Topic(described.name if described else "", item.message_encoding)
            )
            if topic.type in STAMPED and topic.is_read() and not topic.unreadable:
                topic.unreadable = topic.is_read()

    def _take_content(self, content: Content, record: Record, fill: Fill | None) -> None:
        """Count a block's messages. Raises DamageError for unknown channels."""
        if not content.channels.keys() <= self.channels.keys():
            raise DamageError(
                f"the record at byte {record.offset} has messages of an unknown channel"
            )
        for topic, messages in self.by_topic(content).items():
            parts = self.topics[topic].take(messages)
            if parts is not None and fill is not None:
                fill(topic, messages, parts)
        self.blocks.append(Block(record.offset, record.end, frozenset(content.channels)))

    def _look_at(self, record: Record) -> None:
        """Note where a record is, and what is wrong with it."""
        if record.opcode == Opcode.DATA_END:
            self.data_end = record.end
            if not any(record.body[:4]):
                text = "no checksum of the data section: changes outside chunks go undetected"
                self.findings.append(Finding(INFO, text, byte=record.offset))
        elif not is_known(record.opcode):
            self._skipped(record.opcode, record.offset)
        length = record.end - record.offset
        if record.opcode == Opcode.METADATA:
            self.metadata_index.append((record.offset, length, self.metadata_records[-1][0]))
        if record.opcode == Opcode.ATTACHMENT:
            self.attachment_index.append((record.offset, length))

    def _skipped(self, opcode: int, offset: int) -> None:
        text = f"a record of the unknown kind {name_of(opcode)} is skipped"
        self.findings.append(Finding(INFO, text, byte=offset))

    def _look_into(self, record: Record, content: Content) -> None:
        """Note what is in a block, and what is wrong with a chunk."""
        times = [messages.log_time_ns.view(np.uint64) for messages in content.channels.values()]
        spans = [(int(t.min()), int(t.max())) for t in times]
        own = (min(t for t, _ in spans), max(t for _, t in spans)) if spans else (0, 0)
        if spans:
            before = self.span_ns if self.counts else own
            self.span_ns = min(own[0], before[0]), max(own[1], before[1])
        for number, messages in content.channels.items():
            self.counts[number] = self.counts.get(number, 0) + len(messages)
        if record.opcode != Opcode.CHUNK:
            self.outside += sum(map(len, content.channels.values()))
            return
        for opcode in sorted({opcode for opcode, _ in content.others if not is_known(opcode)}):
            self._skipped(opcode, record.offset)
        head = chunk_head(record.body)
        if not head.crc:
            self.findings.append(Finding(INFO, "the chunk has no checksum", byte=record.offset))
        span = head.start_ns, head.end_ns
        if spans and span != own:
            text = "the chunk's time span is not that of its messages"
            self.findings.append(Finding(ERROR, text, byte=record.offset))
        self._last = content
        self.chunks[record.offset] = ChunkIndex(
            chunk_length=record.end - record.offset,
            chunk_start_offset=record.offset,
            compression=head.compression,
            compressed_size=head.length,
            message_end_time=head.end_ns,
            message_index_length=0,
            message_index_offsets={},
            message_start_time=head.start_ns,
            uncompressed_size=head.size,
        )

    def _take_index(self, record: Record) -> None:
        """Take a message index, which has to be that of the last chunk. Raises what NumPy raises."""
        channel, size = _INDEX_HEAD.unpack_from(record.body)
        log, at = np.frombuffer(record.body, "<i8", size // 8, _INDEX_HEAD.size).reshape(-1, 2).T
        order = np.argsort(at, kind="stable")
        messages = self._last.messages([channel])
        if not np.array_equal(
            [log[order], at[order]],
            [messages.log_time_ns, messages.offsets()] if messages else [[], []],
        ):
            text = "the message index is not that of the chunk's messages"
            self.findings.append(Finding(ERROR, text, byte=record.offset))
        index = next(reversed(self.chunks.values()))
        index.message_index_offsets[channel] = record.offset
        index.message_index_length += record.end - record.offset

    def numbers(self, topic: str) -> list[int]:
        """Return the channels of a topic."""
        return self._numbers.get(topic, [])

    def type_of(self, channel: int) -> str:
        """Return the message type of a channel."""
        schema = self.schemas.get(self.channels[channel].schema_id)
        return schema.name if schema else ""

    def stamps(self, messages: Messages) -> Integers:
        """Return each message's stamp in ns [N]: its header's, or else its log time."""
        data, log, start, end = messages
        number = messages.channels()
        stamped = [c for c in np.unique(number).tolist() if self.type_of(c) in STAMPED]
        rows = np.flatnonzero(np.isin(number, stamped) & (end - start >= STAMP_SIZE))
        sec, nanosec = fields_of(type(messages)(data, log[rows], start[rows], end[rows]))
        stamps = log.copy()
        stamps[rows] = sec * NANOSECONDS + nanosec
        return stamps

    def by_topic(
        self, content: Content, topics: Collection[str] | None = None
    ) -> dict[str, Messages]:
        """Return a block's messages by topic, of all topics or of some; none without messages."""
        numbers: dict[str, list[int]] = {}
        for number in sorted(content.channels):
            topic = self.channels[number].topic
            if topics is None or topic in topics:
                numbers.setdefault(topic, []).append(number)
        return {
            topic: messages
            for topic, channels in numbers.items()
            if (messages := content.messages(channels)) is not None and len(messages)
        }

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
    if file.read(len(MAGIC)) != MAGIC:
        raise not_mcap(path, "it does not begin as one: if it is compressed, unpack it")


def numbered(record: Record) -> int | None:
    """Return the number with which a schema's or a channel's record begins; None without one."""
    return _NUMBER.unpack_from(record.body)[0] if len(record.body) >= _NUMBER.size else None


def others_metadata(record: Record) -> tuple[str, dict[str, str]]:
    """Return a metadata record that is not ours; only its digest if it is malformed."""
    with suppress(Exception):  # whatever mcap may raise: nothing in it is needed
        metadata = Metadata.read(record.stream)
        return metadata.name, metadata.metadata
    return "", {"blake2b": hashlib.blake2b(record.body, digest_size=32).hexdigest()}


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


def _is_canonical(record: Record) -> bool:
    """Return False if a record, written anew from what is read of it, is another one."""
    builder = RecordBuilder()
    try:
        _READ[record.opcode](record.stream).write(builder)
    except Exception:  # whatever mcap may raise on a damaged record, which is found elsewhere
        return True
    return record.body.startswith(builder.end()[HEAD.size :])  # longer ones are allowed
