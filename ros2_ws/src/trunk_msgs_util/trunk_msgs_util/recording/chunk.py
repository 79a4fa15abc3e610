"""Decompresses a chunk's records, never more than `MAX_CHUNK` bytes of them.

The sizes that a file claims are not trusted: each is checked against the bound before anything is
decompressed, and the bound also limits what a decompressor may output.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import lz4.frame
import zstandard

from .limits import MAX_CHUNK

_HEAD = struct.Struct("<QQQI")  # start, end, uncompressed size, checksum
_SIZE = struct.Struct("<I")
_LONG = struct.Struct("<Q")


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
        (letters,) = _SIZE.unpack_from(body, _HEAD.size)
        at = _HEAD.size + _SIZE.size + letters
        compression = body[_HEAD.size + _SIZE.size : at].decode()
        (length,) = _LONG.unpack_from(body, at)
    except (struct.error, UnicodeDecodeError):
        raise ValueError("its header makes no sense") from None
    at += _LONG.size
    if at + length > len(body):
        raise ValueError(f"it claims {length} bytes of data but has {len(body) - at}")
    return ChunkHead(start, end, size, crc, compression, at, length)


def chunk_records(body: bytes) -> bytes:
    """Return the records of a chunk, checked against its checksum.

    Raises ValueError for data that are damaged, of a wrong size, or longer than `MAX_CHUNK`.
    """
    head = chunk_head(body)
    if head.size > MAX_CHUNK:
        raise ValueError(f"it claims {head.size} bytes, more than the {MAX_CHUNK} that are read")
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
