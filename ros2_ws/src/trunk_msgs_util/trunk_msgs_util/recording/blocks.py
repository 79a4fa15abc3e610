"""The blocks of an MCAP file, in order, up to the first damage.

A block is what holds messages: a chunk, or a run of messages outside chunks.
"""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from .chunk import chunk_head, chunk_records
from .limits import MAX_CHUNK, Budget, LimitError
from .messages import HEAD, MAGIC
from .split import Content, record_offsets, split

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

BLOCKS = (Opcode.CHUNK, Opcode.MESSAGE)

_CRC = struct.Struct("<I")
_RUN = 1 << 20  # bytes of messages outside chunks that are read at a time, at most
_AHEAD = 1 << 12  # the same, at first: it doubles while nothing else comes
# These may be longer than `MAX_CHUNK`; their content is not read here.
_SKIPPED = (Opcode.ATTACHMENT, Opcode.MESSAGE_INDEX, Opcode.CHUNK_INDEX)
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


class DamageError(ValueError):
    """The file is damaged from some byte on."""


class LimitReachedError(DamageError):
    """The file goes beyond a limit: it is read up to there."""


class ChecksumError(DamageError):
    """The file is complete, but something in it was altered."""


class TrailingError(DamageError):
    """The recording is complete, but the file goes on after it: readers from the end see something else."""


class Record(NamedTuple):
    """A record, or a run of messages outside chunks with their headers (``opcode`` is MESSAGE)."""

    offset: int  # in the file; of the chunk, for a record inside one
    opcode: int
    body: bytes  # empty for attachments, indexes and kinds that are not known
    end: int

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
        if opcode in _SKIPPED or not is_known(opcode):
            first = file.read(min(length, _INDEX_HEAD.size))
            if opcode == Opcode.MESSAGE_INDEX and not _is_index(first, length):
                raise DamageError(f"the MESSAGE_INDEX record at byte {offset} is too short")
            yield Record(offset, opcode, b"", end)
            crc = _skip(file, length - len(first), zlib.crc32(first, zlib.crc32(head, crc)))
        else:
            if length > MAX_CHUNK:
                raise DamageError(
                    f"the {name_of(opcode)} record at byte {offset} claims {length} bytes, "
                    f"more than the {MAX_CHUNK} that are read"
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
            yield Record(offset, opcode, body, end)
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


def _is_index(first: bytes, length: int) -> bool:
    """Return True if a message index has the entries that it claims; more may follow them."""
    return (
        len(first) == _INDEX_HEAD.size and _INDEX_HEAD.unpack(first)[1] <= length - _INDEX_HEAD.size
    )


def _skip(file: BinaryIO, length: int, crc: int) -> int:
    """Read past some bytes and return the checksum continued over them."""
    while length > 0:
        piece = file.read(min(length, _RUN))
        crc = zlib.crc32(piece, crc)
        length -= max(len(piece), 1)
    return crc


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


def content_of(record: Record, budget: Budget | None = None) -> Content:
    """Return the content of a block. Raises DamageError, and LimitReachedError beyond the budget."""
    try:
        if record.opcode != Opcode.CHUNK:
            return split(record.body, budget)
        if budget is not None:
            budget.unpack(chunk_head(record.body).size)
        return split(chunk_records(record.body), budget)
    except LimitError as error:
        raise limit_reached(record, error) from None
    except Exception as error:  # whatever a decompressor may raise on damaged bytes
        raise damaged(record, error) from None


def visit(
    record: Record,
    budget: Budget,
    take_content: Callable[[Content, Record], None],
    take_other: Callable[[Record], None],
) -> None:
    """Give a block's content to one function, and every other record, also one in a chunk, to the other.

    Raises DamageError for whatever ``take_other`` raises, and LimitReachedError for a LimitError.
    """
    content = content_of(record, budget) if record.opcode in BLOCKS else None
    inside = content.others if content is not None else [(record.opcode, record.body)]
    for opcode, body in inside:
        part = Record(record.offset, opcode, body, record.end)
        try:
            take_other(part)
        except LimitError as error:
            raise limit_reached(part, error) from None
        except Exception as error:  # whatever mcap may raise on a damaged record
            raise damaged(part, error) from None
    if content is not None:
        take_content(content, record)


def limit_reached(record: Record, error: LimitError) -> LimitReachedError:
    """Return the error for a record that goes beyond a limit."""
    where = f"at the {name_of(record.opcode)} record at byte {record.offset}"
    return LimitReachedError(f"the file reaches a limit {where}: {error}")


def read_block(file: BinaryIO, offset: int, end: int) -> Record:
    """Return a block that `records` has yielded before."""
    file.seek(offset)
    data = file.read(end - offset)
    if data[:1] == bytes([Opcode.CHUNK]):
        return Record(offset, Opcode.CHUNK, data[HEAD.size :], end)
    return Record(offset, Opcode.MESSAGE, data, end)
