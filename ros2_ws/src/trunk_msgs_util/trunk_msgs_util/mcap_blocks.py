"""The blocks of an MCAP file, in order, as far as the file is sound and no further.

A block is what holds messages: a chunk, or a message that stands outside chunks.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

if TYPE_CHECKING:
    from collections.abc import Iterator

MAGIC = b"\x89MCAP0\r\n"

_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CRC = struct.Struct("<I")


class DamageError(ValueError):
    """The file is not sound from some byte on."""


class ChecksumError(DamageError):
    """The file is whole, but something in it was altered."""


class Record(NamedTuple):
    """A record; ``offset`` is where it, or the chunk that holds it, begins in the file."""

    offset: int
    opcode: int
    body: bytes

    @property
    def stream(self) -> ReadDataStream:
        """What mcap's records read themselves from."""
        return ReadDataStream(BytesIO(self.body))


class Span(NamedTuple):
    """Where a message's data stand in a block's content."""

    log_time_ns: int
    start: int
    end: int


@dataclass
class Content:
    """A block's content, split: spans of messages by channel, and the records beside them."""

    data: bytes
    spans: dict[int, list[Span]] = field(default_factory=dict)
    records: list[Record] = field(default_factory=list)


def _name(opcode: int) -> str:
    return Opcode(opcode).name if opcode in Opcode._value2member_map_ else f"record {opcode:#x}"


def records(file: BinaryIO, size: int) -> Iterator[Record]:
    """Yield the records of a file of ``size`` bytes that stands behind its magic.

    Raises DamageError at a record that the file does not hold whole, and ChecksumError behind the
    data where they do not have the checksum that they were written with.
    """
    crc = zlib.crc32(MAGIC)
    offset = len(MAGIC)
    while offset < size:
        head = file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            raise DamageError(f"ends at byte {size}, in a record's head at byte {offset}")
        opcode, length = _RECORD.unpack(head)
        end = offset + _RECORD.size + length
        if end > size:
            raise DamageError(
                f"ends at byte {size}, inside the {_name(opcode)} record at byte {offset}"
            )
        body = file.read(length)
        if opcode == Opcode.DATA_END:
            (expected,) = _CRC.unpack(body[:4].ljust(4, b"\x00"))
            if expected not in (0, crc):
                raise ChecksumError(f"the checksum of the first {offset} bytes is wrong")
        crc = zlib.crc32(body, zlib.crc32(head, crc))
        yield Record(offset, opcode, body)
        if opcode == Opcode.FOOTER:
            if file.read(len(MAGIC)) != MAGIC:
                raise DamageError(f"ends at byte {size}, without the closing magic at byte {end}")
            return
        offset = end
    raise DamageError(f"ends at byte {size}, without a footer")


def damaged(record: Record, error: Exception) -> DamageError:
    """Return what to raise where a record's body makes no sense."""
    what = str(error) or type(error).__name__
    return DamageError(
        f"the {_name(record.opcode)} record at byte {record.offset} is damaged ({what})"
    )


def content_of(record: Record) -> Content:
    """Return the content of a chunk, or of a message outside chunks. Raises DamageError."""
    try:
        if record.opcode == Opcode.CHUNK:
            stream, length = get_chunk_data_stream(Chunk.read(record.stream), validate_crc=True)
            return _split(stream.read(length), record.offset)
        message = _RECORD.pack(record.opcode, len(record.body)) + record.body
        return _split(message, record.offset)
    except Exception as error:  # whatever damaged bytes make of the decompressor and of mcap
        raise damaged(record, error) from None


def _split(data: bytes, offset: int) -> Content:
    content = Content(data)
    at, size = 0, len(data)
    while at < size:
        opcode, length = _RECORD.unpack_from(data, at)
        start = at + _RECORD.size
        end = start + length
        if end > size:
            raise ValueError("a record goes beyond its chunk")
        if opcode == Opcode.MESSAGE:
            channel, _, log_time_ns, _ = _MESSAGE.unpack_from(data, start)
            span = Span(log_time_ns, start + _MESSAGE.size, end)
            spans = content.spans.get(channel)
            if spans is None:
                content.spans[channel] = [span]
            else:
                spans.append(span)
        else:
            content.records.append(Record(offset, opcode, data[start:end]))
        at = end
    return content


def read_record(file: BinaryIO, offset: int) -> Record:
    """Return the record at a byte offset that `records` has yielded before."""
    file.seek(offset)
    opcode, length = _RECORD.unpack(file.read(_RECORD.size))
    return Record(offset, opcode, file.read(length))
