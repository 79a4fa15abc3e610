"""The content of a chunk, unpacked and split, and the digests of a recording's whole content.

A chunk's records are unpacked within bounds, and its messages split in bulk, by channel. The sizes that a
file claims are not trusted: each is checked against the bound before anything is decompressed, and the bound
also limits what a decompressor may output. Each record's length gives the start of the next. The index
behind a chunk says where its messages begin: NumPy compares that with all lengths at once, and what it
leaves out, or has wrong, is read one by one.

Any accidental damage or edit changes the digests. The recorder writes them last; a reader computes them
again. They are BLAKE2b, 32 bytes, over bytes that do not depend on compression or on the limits of chunks:

- for each topic, its messages in the order of the file;
- ``heads``: length, channel, sequence, log time and publish time of every message in the order of the
  file, so the order across topics too;
- ``channels``: topic, encoding, metadata and schema of every channel;
- ``metadata``: every metadata record in the order of the file, except the digests themselves;
- ``header``: profile and library of the file; ``attachments``: how many there are.

They are not a secret: whoever rewrites a recording can write new digests. Who vouches for a file, its
signature says.
"""

from __future__ import annotations

import hashlib
import json
import struct
import zlib
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode

from .messages import HEAD, LIMIT, Messages, data_starts, head_field, unaligned

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

    from trunk_core.arrays import Integers

_HEAD = struct.Struct("<QQQI")  # start, end, uncompressed size, checksum
_LENGTH = struct.Struct("<I")
_LONG = struct.Struct("<Q")
NOWHERE = np.empty(0, np.int64)
_OTHERS = 1 << 18  # records that are not messages: as many as schemas and channels can exist


class ChunkHead(NamedTuple):
    """A chunk's header; ``start`` and ``end`` bound its log times, in ns."""

    start_ns: int
    end_ns: int
    size: int  # uncompressed
    crc: int  # 0: none
    compression: str
    at: int  # start of the compressed data in the record's body
    length: int  # of the compressed data


def chunk_head(body: bytes) -> ChunkHead:
    """Return the header in a chunk record's body. Raises ValueError if it makes no sense."""
    try:
        start, end, size, crc = _HEAD.unpack_from(body)
        (letters,) = _LENGTH.unpack_from(body, _HEAD.size)
        at = _HEAD.size + _LENGTH.size + letters
        compression = body[_HEAD.size + _LENGTH.size : at].decode()
        (length,) = _LONG.unpack_from(body, at)
    except (struct.error, UnicodeDecodeError):
        raise ValueError("its header makes no sense") from None
    at += _LONG.size
    if at + length > len(body):
        raise ValueError(f"it claims {length} bytes of data but has {len(body) - at}")
    return ChunkHead(start, end, size, crc, compression, at, length)


def chunk_records(body: bytes) -> bytes:
    """Return the records of a chunk, checked against its checksum.

    Raises ValueError for data that are damaged, of a wrong size, or longer than `LIMIT`.
    """
    head = chunk_head(body)
    if head.size > LIMIT:
        raise ValueError(f"it claims {head.size} bytes, more than the {LIMIT} that are read")
    data = _decompressed(body[head.at : head.at + head.length], head.compression, head.size)
    if len(data) != head.size:
        raise ValueError(f"it claims {head.size} bytes and holds {len(data)}")
    if head.crc and zlib.crc32(data) != head.crc:
        raise ValueError("its checksum is wrong")
    return data


def _decompressed(data: bytes, compression: str, size: int) -> bytes:
    if compression == "":
        return data
    if compression == "zstd":
        return _zstd(data, size)
    if compression == "lz4":
        return _lz4(data, size)
    raise ValueError(f"compression {compression!r} is not known, only zstd, lz4 and none")


def _zstd(data: bytes, size: int) -> bytes:
    try:
        claimed = zstandard.frame_content_size(data)  # -1: the frame does not say
        if claimed not in (-1, size):
            raise ValueError(f"it claims {size} bytes and its Zstandard frame {claimed}")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=max(size, 1))
    except zstandard.ZstdError as error:
        raise ValueError(f"it cannot be decompressed: {error}") from None


def _lz4(data: bytes, size: int) -> bytes:
    try:
        decompressor = lz4.frame.LZ4FrameDecompressor()
        unpacked: bytes = decompressor.decompress(data, max_length=size + 1)
    except (RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"it cannot be decompressed: {error}") from None
    return unpacked


@dataclass(frozen=True)
class Content:
    """The records of a chunk: messages by channel, and the other records."""

    data: bytes
    channels: dict[int, Messages] = field(default_factory=dict)
    others: list[tuple[int, bytes]] = field(default_factory=list)  # opcode, body

    def messages(self, channels: Iterable[int]) -> Messages | None:
        """Return the messages of some channels in file order, or None."""
        selected = [self.channels[c] for c in channels if c in self.channels]
        if len(selected) < 2:
            return selected[0] if selected else None
        log, start, end = (
            np.concatenate(columns) for columns in list(zip(*selected, strict=True))[1:]
        )
        order = np.argsort(start)
        return Messages(self.data, log[order], start[order], end[order])


def split(data: bytes, indexed: Integers = NOWHERE) -> Content:
    """Return the content of a chunk. Raises ValueError if its records make no sense.

    ``indexed``: where its index says that messages begin.
    """
    offsets, end = record_offsets(data, indexed)
    if end != len(data):
        raise ValueError("a record goes beyond its chunk")
    opcodes = np.frombuffer(data, np.uint8)[offsets]
    ends = np.append(offsets[1:], end)
    is_message = opcodes == Opcode.MESSAGE
    content = Content(data)
    others = np.flatnonzero(~is_message)
    if len(others) > _OTHERS:
        raise ValueError(f"it has {len(others)} records that are not messages")
    content.others.extend(
        (int(opcodes[i]), data[offsets[i] + HEAD.size : ends[i]]) for i in others.tolist()
    )
    if len(others):
        if not opcodes[others].all():
            raise ValueError("a record of kind 0x00, which is not valid")
        offsets, ends = offsets[is_message], ends[is_message]
    if not len(offsets):
        return content
    starts = data_starts(offsets)
    if (ends < starts).any():
        raise ValueError("a message is too short for its header")
    # A time beyond the year 2262 becomes negative: whoever counts the messages leaves those out.
    log = head_field(data, offsets, "log_time").view(np.int64)
    channel = head_field(data, offsets, "channel")
    order = np.argsort(channel, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(channel[order])) + 1):
        number = int(channel[rows[0]])
        content.channels[number] = Messages(data, log[rows], starts[rows], ends[rows])
    return content


def record_offsets(data: bytes, indexed: Integers = NOWHERE) -> tuple[Integers, int]:
    """Return the first byte of each whole record [N], and the end of the last one.

    ``indexed``: where an index says that records begin, in any order.
    """
    last, at, offsets = len(data) - HEAD.size, 0, array("q")
    known = np.sort(indexed, kind="stable")  # each channel's are in order
    known = known[slice(*np.searchsorted(known, [0, last + 1]))]
    ends = known + HEAD.size + unaligned(data, "<i8")[known + 1]
    stops = np.flatnonzero(np.append(ends[:-1] != known[1:], [True] * len(known[:1])))
    starts = np.append(0, stops + 1)[: len(stops)]
    runs = dict(zip(known[starts].tolist(), zip(starts, stops, strict=True), strict=True))
    while at <= last:
        if at in runs:  # up to the run's last record
            start, stop = runs[at]
            offsets.frombytes(known[start:stop].tobytes())
            at = int(known[stop])
        following = at + HEAD.size + _LONG.unpack_from(data, at + 1)[0]
        if following > len(data):
            break
        offsets.append(at)
        at = following
    return np.frombuffer(offsets, np.int64), at


# Names of our metadata records.
PROVENANCE, END, DIGESTS = "trunk_provenance", "trunk_end", "trunk_digests"
HEADS, CHANNELS, METADATA = "heads", "channels", "metadata"
HEADER, ATTACHMENTS = "header", "attachments"
# What is covered besides the topics, with its name in messages.
PARTS = {
    HEADS: "the messages' order, sequence numbers, log or publish times",
    CHANNELS: "the channels or schemas",
    METADATA: "the metadata records (origin, end)",
    HEADER: "the file's header",
    ATTACHMENTS: "the attachments",
}
_SIZE = 32


def _new() -> hashlib.blake2b:
    return hashlib.blake2b(digest_size=_SIZE)


def _of(values: object) -> str:
    text = json.dumps(values, ensure_ascii=True, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=_SIZE).hexdigest()


class RunningDigests:
    """The digests of a recording while it is written or read."""

    def __init__(self) -> None:
        self._topics: dict[str, hashlib.blake2b] = {}
        self._heads = _new()
        self._channels: list[object] = []
        self._metadata: list[object] = []
        self._header: list[str] = []
        self._attachments = 0

    def header(self, profile: str, library: str) -> None:
        """Take a file's header."""
        self._header += [profile, library]

    def channel(self, channel: Channel, schema: Schema | None) -> None:
        """Take a channel and its schema."""
        self._topics.setdefault(channel.topic, _new())
        description = [schema.name, schema.encoding, schema.data.hex()] if schema else []
        self._channels.append(
            [
                channel.id,
                channel.topic,
                channel.message_encoding,
                dict(channel.metadata),
                description,
            ]
        )

    def content(self, channels: Mapping[int, Channel], content: Content) -> None:
        """Take the messages of a block."""
        whole = content.messages(content.channels)
        if whole is not None:
            self.heads(whole.heads())
        for number, messages in content.channels.items():
            self.messages(channels[number].topic, messages.joined())

    def messages(self, topic: str, data: bytes) -> None:
        """Take one or more messages of a topic, without their heads."""
        self._topics.setdefault(topic, _new()).update(data)

    def heads(self, heads: bytes) -> None:
        """Take the heads of one or more message records, as they are in the file."""
        self._heads.update(heads)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Take a metadata record."""
        if name != DIGESTS:
            self._metadata.append([name, dict(values)])

    def attachment(self) -> None:
        """Take an attachment."""
        self._attachments += 1

    def values(self) -> dict[str, str]:
        """Return all digests so far, by the topic's name or the part."""
        return {
            **{topic: digest.hexdigest() for topic, digest in self._topics.items()},
            HEADS: self._heads.hexdigest(),
            CHANNELS: _of(self._channels),
            METADATA: _of(self._metadata),
            HEADER: _of(self._header),
            ATTACHMENTS: str(self._attachments),
        }


def differing(recorded: Mapping[str, str], computed: Mapping[str, str]) -> list[str]:
    """Return the topics and parts whose recorded digest is not the computed one."""
    return sorted(
        PARTS.get(key, key) for key, digest in recorded.items() if computed.get(key) != digest
    )


def uncoverable(topics: Iterable[str], attachments: int, unknown: Iterable[str]) -> list[str]:
    """Return the parts without digests: attachments, topics whose name is that of a part, unknown records."""
    parts = [f"a topic with the name {topic}" for topic in sorted(topics) if topic in PARTS]
    parts += ["the attachments' content"] if attachments else []
    kinds = ", ".join(sorted(set(unknown)))
    return parts + ([f"records of unknown kinds ({kinds})"] if kinds else [])


def uncovered(recorded: Mapping[str, str], topics: Iterable[str]) -> list[str]:
    """Return the parts, and those of ``topics``, that have no recorded digest."""
    return [PARTS.get(key, key) for key in (*sorted(topics), *PARTS) if key not in recorded]
