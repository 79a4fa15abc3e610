"""Small files that claim, or unpack to, far more than they hold."""

import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import lz4.frame
import zstandard
from mcap.records import Metadata
from ros2_ws.src.trunk_recording.test.mcap_files import (
    channel,
    chunk,
    message,
    raw,
    record,
    schema,
    write_records,
    zstd_frame_that_claims,
)

from trunk_core.topics import DIAGNOSTIC_ARRAY_TYPE, JOINT_STATE_TYPE, PARAMETER_EVENT_TYPE
from trunk_recording import schemas
from trunk_recording.messages import LIMIT

from .tampered import FAR_NS, GIVEN, SAID, TRUTH, joint_state

MB, TB = 1 << 20, 1 << 40
_DESCRIBED = schema(1, JOINT_STATE_TYPE) + channel(1, TRUTH)


def _joints(number: int, k: int, names: list[str], frame: str = "") -> bytes:
    values = [0.1] * len(names)
    return message(number, k, joint_state(k * 10**7, names, values, values, values, frame))


def _packed(records: bytes) -> bytes:
    return chunk(records)


def _many(each: bytes, count: int) -> bytes:
    """Return a chunk of one record, repeated, without ever holding it unpacked."""
    compressor = zstandard.ZstdCompressor().compressobj(size=len(each) * count)
    piece = each * 1000
    packed = b"".join(compressor.compress(piece) for _ in range(count // 1000))
    packed += compressor.compress(each * (count % 1000)) + compressor.flush()
    return chunk(b"", size=len(each) * count, packed=packed)


def names_one_by_one(count: int = 20_000) -> Iterator[bytes]:
    """Every message names another joint: N messages make a table of N x N."""
    yield _packed(_DESCRIBED + b"".join(_joints(1, k, [f"j{k}"]) for k in range(count)))


def names_at_once(count: int = 1_000_000) -> Iterator[bytes]:
    """One message names a million joints."""
    names = b"".join(b"\x08\0\0\0%07d\0" % k for k in range(count))
    empty = joint_state(0, [])  # it ends with four counts of 0
    data = empty[:-16] + struct.pack("<I", count) + names + empty[-12:]
    yield _packed(_DESCRIBED + message(1, 0, data))


def layouts_changing(count: int = 100_000) -> Iterator[bytes]:
    """Every message has a frame of another length."""
    yield _packed(
        _DESCRIBED
        + b"".join(_joints(1, k, ["hip", "trunk"], "f" * (k % 500)) for k in range(count))
    )


def channels(count: int = 65_536) -> Iterator[bytes]:
    """As many topics as there are numbers, a message on each."""
    yield schema(1, JOINT_STATE_TYPE)
    yield _packed(b"".join(channel(k, f"/t{k}") for k in range(count)))
    yield _packed(b"".join(_joints(k, k, ["hip", "trunk"]) for k in range(count)))


def one_large_message(count: int = 100) -> Iterator[bytes]:
    """Chunks with one message of 100 MB each."""
    yield _DESCRIBED + schema(2, "sensor_msgs/msg/Image") + channel(2, "/image", 2)
    data = zstandard.compress(message(2, 0, bytes(100 * MB)))
    for _ in range(count):
        yield chunk(b"", size=100 * MB + 31, packed=data)


def metadata_packed(count: int = 1_000_000) -> Iterator[bytes]:
    """The same in a chunk."""
    yield _many(record(Metadata("trunk_provenance", {"key": "x"})), count)


def long_provenance() -> Iterator[bytes]:
    """Names and values of a megabyte each."""
    yield record(
        Metadata("trunk_provenance", {"k" * MB: "v" * MB, **{f"{i}": "x" for i in range(5000)}})
    )
    yield _packed(_DESCRIBED + _joints(1, 0, ["hip", "trunk"]))


def events_repeated(count: int = 300_000) -> Iterator[bytes]:
    """Many equal events."""
    yield schema(1, DIAGNOSTIC_ARRAY_TYPE) + channel(1, SAID)
    yield _many(message(1, 0, schemas.event(0, "/simulator", "reset")), count)


def many_parameters(count: int = 100_000) -> Iterator[bytes]:
    """A node with a hundred thousand parameters, again and again."""
    data = schemas.parameter_event(0, "/pid", {f"p{k}": 1.0 for k in range(count)}, {})
    yield schema(1, PARAMETER_EVENT_TYPE) + channel(1, GIVEN)
    yield _packed(message(1, 0, data) * 5)


def claims_parameters() -> Iterator[bytes]:
    """A node that claims 2^31 parameters."""
    yield schema(1, PARAMETER_EVENT_TYPE) + channel(1, GIVEN)
    none = schemas.parameter_event(0, "/pid", {}, {})  # it ends with three counts of 0
    yield message(1, 0, none[:-12] + struct.pack("<I", 2**31 - 1))


def far_apart() -> Iterator[bytes]:
    """Two states, 68 years apart."""
    yield _DESCRIBED
    yield message(1, 0, joint_state(0, ["hip", "trunk"], [0.0] * 2, [0.0] * 2, [0.0] * 2))
    yield message(1, 1, joint_state(FAR_NS, ["hip", "trunk"], [0.0] * 2, [0.0] * 2, [0.0] * 2))


def lz4_bomb() -> Iterator[bytes]:
    """LZ4 that unpacks to 2 GB, and says 1000 bytes."""
    packed = lz4.frame.compress(bytes(256 * MB))
    yield chunk(b"", size=1000, compression="lz4", packed=packed * 8)


def zstd_window() -> Iterator[bytes]:
    """A Zstandard frame that asks for a window of 2 GB."""
    frame = struct.pack("<IBB", 0xFD2FB528, 0, 21 << 3) + b"\x01\x00\x00"
    yield chunk(b"", size=100 * MB, packed=frame)


FILES: dict[str, Callable[[], Iterable[bytes]]] = {
    "20,000 names, one a message": names_one_by_one,
    "a million names at once": names_at_once,
    "a layout for each message": layouts_changing,
    "65,536 topics": channels,
    "messages of 100 MB": one_large_message,
    "metadata in a chunk": metadata_packed,
    "a long provenance": long_provenance,
    "events repeated": events_repeated,
    "a hundred thousand parameters": many_parameters,
    "2^31 parameters claimed": claims_parameters,
    "two states, 68 years apart": far_apart,
    "an LZ4 bomb": lz4_bomb,
    "a window of 2 GB": zstd_window,
    "a chunk of 1 TB": lambda: [chunk(b"x", size=TB)],
    "a frame of 1 TB": lambda: [chunk(b"", size=1000, packed=zstd_frame_that_claims(TB))],
    "both of 1 TB": lambda: [chunk(b"", size=TB, packed=zstd_frame_that_claims(TB))],
    "a Zstandard bomb": lambda: [chunk(bytes(512 * MB), size=1000)],
    "an honest bomb": lambda: [chunk(bytes(512 * MB))],
    "records without a message": lambda: [chunk((b"\x09" + bytes(8)) * (LIMIT // 9))],
    "a record of 1 TB": lambda: [raw(4, length=TB)],
    "a record of 2^64 - 1 bytes": lambda: [raw(5, length=2**64 - 1)],
    "a string of 4 GB": lambda: [raw(4, b"\1\0\1\0\xff\xff\xff\xff")],
    "an attachment of 1 TB": lambda: [raw(9, bytes(100), TB)],
    "a chunk inside of a chunk": lambda: [chunk(chunk(b"", compression=""), compression="")],
}


def make(name: str, path: Path) -> Path:
    """Write one of `FILES`."""
    return write_records(path, *FILES[name]())
