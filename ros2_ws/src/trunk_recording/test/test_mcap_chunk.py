import struct
import tracemalloc
import zlib

import lz4.frame
import pytest
import zstandard

from trunk_recording.digests import chunk_records
from trunk_recording.messages import LIMIT

from .mcap_files import chunk, zstd_frame_that_claims

DATA = b"some records" * 50
TB = 1 << 40


def body(data: bytes, **options) -> bytes:
    return chunk(b"", packed=data, **options)[9:]


def lz4_frame_that_claims(size: int) -> bytes:
    frame = bytearray(lz4.frame.compress(DATA, store_size=True))
    frame[6:14] = struct.pack("<Q", size)
    return bytes(frame)


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_records_come_back(compression):
    compress = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[compression]
    options = {"size": len(DATA), "compression": compression, "crc": zlib.crc32(DATA)}
    assert chunk_records(body(compress(DATA), **options)) == DATA
    with pytest.raises(ValueError, match="checksum"):
        chunk_records(body(compress(DATA), **{**options, "crc": 1}))


def test_frames_without_a_size_are_read():
    stream = zstandard.ZstdCompressor(write_content_size=False).compress(DATA)
    assert zstandard.frame_content_size(stream) == -1
    assert chunk_records(body(stream, size=len(DATA), compression="zstd")) == DATA


BOMB = bytes(LIMIT + 1)


@pytest.mark.parametrize(
    ("data", "size", "compression", "says"),
    [
        (zstandard.compress(DATA), TB, "zstd", "claims 1099511627776 bytes, more than"),
        (DATA, LIMIT + 1, "", "more than"),
        (zstd_frame_that_claims(TB), 100, "zstd", "its Zstandard frame 1099511627776"),
        (zstandard.compress(BOMB), 100, "zstd", "its Zstandard frame"),
        (
            zstandard.ZstdCompressor(write_content_size=False).compress(BOMB),
            100,
            "zstd",
            "cannot be decompressed",
        ),
        (lz4.frame.compress(BOMB), 100, "lz4", "holds 101"),
        (lz4_frame_that_claims(TB), 100, "lz4", "cannot be decompressed|holds"),
        (zstandard.compress(DATA), len(DATA) + 1, "zstd", "claims 601 bytes"),
        (lz4.frame.compress(DATA), len(DATA) + 1, "lz4", "holds 600"),
        (DATA, len(DATA) - 1, "", "holds 600"),
        (b"", 100, "zstd", "cannot be decompressed"),
        (b"", 100, "lz4", "holds 0|cannot be decompressed"),
        (DATA, len(DATA), "brotli", "'brotli' is not known"),
    ],
    ids=range(13),
)
def test_false_sizes_are_refused_at_no_cost(data, size, compression, says):
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=says):
            chunk_records(body(data, size=size, compression=compression))
        assert tracemalloc.get_traced_memory()[1] < 2 * len(data) + (1 << 22)
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("size", [0, 10, 31, 40, 47])
def test_a_cut_header_is_refused(size):
    whole = body(DATA, size=len(DATA), compression="")
    with pytest.raises(ValueError, match=r"header makes no sense|claims 600"):
        chunk_records(whole[:size])
