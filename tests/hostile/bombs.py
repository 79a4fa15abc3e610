"""Small files that claim, or unpack to, far more than they hold."""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
import zstandard
from mcap.records import Attachment, Metadata
from ros2_ws.src.trunk_msgs_util.test.mcap_files import (
    channel,
    chunk,
    message,
    record,
    schema,
    write_records,
)

from trunk_msgs_util.recording import schemas
from trunk_msgs_util.topics import (
    DIAGNOSTIC_ARRAY_TYPE,
    JOINT_STATE_TYPE,
    PARAMETER_EVENT_TYPE,
)

from .tampered import COMMAND, FAR_NS, GIVEN, SAID, SEEN, TRUTH, joint_state

MB = 1 << 20
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


def names_changing() -> Iterator[bytes]:
    """Messages with a hundred names each, of which one is new."""
    yield _packed(
        _DESCRIBED + b"".join(_joints(1, k, [f"j{k + i}" for i in range(100)]) for k in range(3000))
    )


def layouts_changing(count: int = 100_000) -> Iterator[bytes]:
    """Every message has a frame of another length."""
    yield _packed(
        _DESCRIBED
        + b"".join(_joints(1, k, ["hip", "trunk"], "f" * (k % 500)) for k in range(count))
    )


def channels_repeated(chunks: int = 100) -> Iterator[bytes]:
    """Chunks with nothing but the same channel, again and again."""
    yield _DESCRIBED
    for _ in range(chunks):
        yield _many(channel(1, TRUTH), 200_000)


def channels_for_one_topic(count: int = 65_535) -> Iterator[bytes]:
    """One topic on every channel there is, a message on each."""
    yield schema(1, JOINT_STATE_TYPE)
    yield _packed(b"".join(channel(k, TRUTH) for k in range(1, count)))
    yield _packed(b"".join(_joints(k, k, ["hip", "trunk"]) for k in range(1, count)))


def channels(count: int = 65_536) -> Iterator[bytes]:
    """As many topics as there are numbers, a message on each."""
    yield schema(1, JOINT_STATE_TYPE)
    yield _packed(b"".join(channel(k, f"/t{k}") for k in range(count)))
    yield _packed(b"".join(_joints(k, k, ["hip", "trunk"]) for k in range(count)))


def channels_in_many_chunks(count: int = 3000) -> Iterator[bytes]:
    """A topic and a message on it in each of many chunks."""
    yield schema(1, JOINT_STATE_TYPE)
    for k in range(count):
        yield chunk(channel(k, f"/t{k}") + _joints(k, k, ["hip", "trunk"]), compression="")


def schemas_numbered(count: int = 65_535) -> Iterator[bytes]:
    """As many schemas as there are numbers."""
    yield _packed(b"".join(schema(k, JOINT_STATE_TYPE) for k in range(1, count)))
    yield _packed(channel(1, TRUTH) + _joints(1, 0, ["hip", "trunk"]))


def chunks_of_one(count: int = 20_000) -> Iterator[bytes]:
    """A message in each of many chunks."""
    yield _DESCRIBED
    for k in range(count):
        yield chunk(_joints(1, k, ["hip", "trunk"]), compression="")


def chunks_of_nothing(count: int = 100_000) -> Iterator[bytes]:
    """Chunks without a record."""
    yield _DESCRIBED
    yield chunk(b"", compression="") * count


def chunk_bombs(count: int = 500) -> Iterator[bytes]:
    """Chunks of 100 MB each, 5 GB in all."""
    yield _DESCRIBED
    bomb = _many(message(1, 0, joint_state(0, ["hip", "trunk"], [0.0] * 2)), 1_000_000)
    for _ in range(count):
        yield bomb


def one_large_message(count: int = 100) -> Iterator[bytes]:
    """Chunks with one message of 100 MB each."""
    yield _DESCRIBED + schema(2, "sensor_msgs/msg/Image") + channel(2, "/image", 2)
    data = zstandard.compress(message(2, 0, bytes(100 * MB)))
    for _ in range(count):
        yield chunk(b"", size=100 * MB + 31, packed=data)


def equal_messages(count: int = 1_000_000) -> Iterator[bytes]:
    """A million equal messages."""
    yield _DESCRIBED
    for number, topic in ((1, TRUTH), (2, SEEN), (3, COMMAND)):
        yield channel(number, topic)
        yield _many(message(number, 0, joint_state(0, ["hip", "trunk"], [0.0] * 2)), count // 3)


def empty_messages(count: int = 4_000_000) -> Iterator[bytes]:
    """Messages without a byte."""
    yield _DESCRIBED
    yield _many(message(1, 0, b""), count)


def messages_and_others_in_turn(count: int = 20_000) -> Iterator[bytes]:
    """Outside chunks, a message, a channel, a message, a channel ..."""
    yield _DESCRIBED
    for k in range(count):
        yield _joints(1, k, ["hip", "trunk"]) + channel(1, TRUTH)


def metadata_repeated(count: int = 100_000) -> Iterator[bytes]:
    """Many metadata records."""
    for k in range(count):
        yield record(Metadata("trunk_provenance", {f"key{k}": "x"}))


def metadata_packed(count: int = 1_000_000) -> Iterator[bytes]:
    """The same in a chunk."""
    yield _many(record(Metadata("trunk_provenance", {"key": "x"})), count)


def long_provenance() -> Iterator[bytes]:
    """Names and values of a megabyte each."""
    yield record(
        Metadata("trunk_provenance", {"k" * MB: "v" * MB, **{f"{i}": "x" for i in range(5000)}})
    )
    yield _packed(_DESCRIBED + _joints(1, 0, ["hip", "trunk"]))


def long_topic() -> Iterator[bytes]:
    """A topic whose name is a megabyte, among a thousand others."""
    yield schema(1, JOINT_STATE_TYPE)
    yield _packed(channel(0, "/" + "t" * MB) + _joints(0, 0, ["hip", "trunk"]))
    yield _packed(b"".join(channel(k, f"/t{k}") for k in range(1, 1000)))


def long_joint() -> Iterator[bytes]:
    """A joint whose name is ten megabytes."""
    yield _packed(_DESCRIBED + _joints(1, 0, ["t" * 10 * MB, "trunk"]))


def long_frame() -> Iterator[bytes]:
    """A frame of fifty megabytes."""
    yield _packed(_DESCRIBED + _joints(1, 0, ["hip", "trunk"], "f" * 50 * MB))


def long_schema() -> Iterator[bytes]:
    """A schema of fifty megabytes."""
    yield _packed(schema(1, JOINT_STATE_TYPE, bytes(50 * MB)) + channel(1, TRUTH))
    yield _packed(_joints(1, 0, ["hip", "trunk"]))


def events_repeated(count: int = 300_000) -> Iterator[bytes]:
    """Many equal events."""
    yield schema(1, DIAGNOSTIC_ARRAY_TYPE) + channel(1, SAID)
    yield _many(message(1, 0, schemas.event(0, "/simulator", "reset")), count)


def resets(count: int = 50_000) -> Iterator[bytes]:
    """A reset and a change at every nanosecond."""
    yield _DESCRIBED + schema(2, DIAGNOSTIC_ARRAY_TYPE) + channel(2, SAID)
    yield _packed(b"".join(_joints(1, k, ["hip", "trunk"]) for k in range(200)))
    yield _packed(
        b"".join(message(2, k, schemas.event(k, "/simulator", "reset")) for k in range(count))
    )


def long_event() -> Iterator[bytes]:
    """An event with a million values."""
    event = schemas.event(
        0, "/simulator", "finished", {"key": "val"}
    )  # the pair is its last 16 bytes
    data = event[:-20] + struct.pack("<I", 1_000_000) + event[-16:] * 1_000_000
    yield schema(1, DIAGNOSTIC_ARRAY_TYPE) + channel(1, SAID)
    yield _packed(message(1, 0, data))


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


def attachments(count: int = 50_000) -> Iterator[bytes]:
    """Many attachments."""
    yield record(Attachment(0, 0, "a", "b", b"")) * count


FILES: dict[str, Callable[[], Iterator[bytes]]] = {
    "20,000 names, one a message": names_one_by_one,
    "a million names at once": names_at_once,
    "a hundred names, always one new": names_changing,
    "a layout for each message": layouts_changing,
    "channel records repeated": channels_repeated,
    "one topic on 65,534 channels": channels_for_one_topic,
    "65,536 topics": channels,
    "a topic in each chunk": channels_in_many_chunks,
    "65,534 schemas": schemas_numbered,
    "a message in each chunk": chunks_of_one,
    "chunks of nothing": chunks_of_nothing,
    "chunks of 100 MB": chunk_bombs,
    "messages of 100 MB": one_large_message,
    "a million equal messages": equal_messages,
    "messages without a byte": empty_messages,
    "messages and channels in turn": messages_and_others_in_turn,
    "metadata repeated": metadata_repeated,
    "metadata in a chunk": metadata_packed,
    "a long provenance": long_provenance,
    "a long topic": long_topic,
    "a long joint": long_joint,
    "a long frame": long_frame,
    "a long schema": long_schema,
    "events repeated": events_repeated,
    "resets at each nanosecond": resets,
    "a long event": long_event,
    "a hundred thousand parameters": many_parameters,
    "2^31 parameters claimed": claims_parameters,
    "two states, 68 years apart": far_apart,
    "an LZ4 bomb": lz4_bomb,
    "a window of 2 GB": zstd_window,
    "attachments": attachments,
}


def make(name: str, path: Path) -> Path:
    """Write one of `FILES`."""
    return write_records(path, *FILES[name]())
