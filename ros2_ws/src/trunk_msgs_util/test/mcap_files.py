"""MCAP files as other recorders would write them, and pieces of hostile ones."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, McapRecord
from mcap.writer import CompressionType, IndexType, Writer

from trunk_msgs_util import topics
from trunk_msgs_util.recording import schemas

COMPRESSIONS = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
MAGIC = b"\x89MCAP0\r\n"


def write_mcap(
    path: Path,
    messages,
    *,
    compression="zstd",
    library="foreign",
    encoding="cdr",
    first=(),
    **options,
) -> Path:
    """Write (topic, log time, CDR) of JointState topics; options are those of mcap's writer.

    ``first``: metadata records, (name, values), that come before the messages.
    """
    options = {"chunk_size": 4096, "index_types": IndexType.ALL, **options}
    with path.open("wb") as file:
        writer = Writer(file, compression=COMPRESSIONS[compression], **options)
        writer.start("ros2", library)
        for name, values in first:
            writer.add_metadata(name, values)
        text = schemas.definition(topics.JOINT_STATE_TYPE)
        schema = writer.register_schema(topics.JOINT_STATE_TYPE, "ros2msg", text)
        channels: dict[str, int] = {}
        for topic, log_time_ns, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns)
        writer.finish()
    return path


def record(body: McapRecord) -> bytes:
    builder = RecordBuilder()
    body.write(builder)
    return builder.end()


def message(channel: int, log_time_ns: int, data: bytes) -> bytes:
    head = struct.pack("<HIQQ", channel, 0, log_time_ns, log_time_ns)
    return struct.pack("<BQ", 5, len(head) + len(data)) + head + data


def chunk(data: bytes, *, size: int, compression: str, crc: int = 0) -> Chunk:
    return Chunk(compression, data, 0, 0, crc, size)


def with_chunk(path: Path, hostile: bytes) -> Path:
    """Write an empty recording with some bytes between its header and its end."""
    buffer = io.BytesIO()
    writer = Writer(buffer, enable_data_crcs=False)
    writer.start("ros2", "foreign")
    head = buffer.tell()
    writer.finish()
    whole = buffer.getvalue()
    tail = whole[head:]
    # The footer gives the place of the summary: there is none.
    data_end = tail[: 9 + 4]
    footer = struct.pack("<BQQQ", 2, 20, 0, 0)
    footer += struct.pack("<I", zlib.crc32(footer))
    path.write_bytes(whole[:head] + hostile + data_end + footer + MAGIC)
    return path
