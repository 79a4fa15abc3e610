"""Chunks by `ChunkedWriter` and by the library's writer: the same file, byte for byte."""

from __future__ import annotations

import io
from collections import defaultdict

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from trunk_msgs_util.recording.writing import chunked
from trunk_msgs_util.recording.writing.chunked import HEAD, ChunkedWriter

TIMES = st.integers(0, 2**63 - 1) | st.integers(0, 5)
MESSAGES = st.tuples(st.just("message"), st.integers(0, 2), TIMES, TIMES, st.binary(max_size=40))
OTHERS = st.sampled_from([("flush",), ("metadata",), ("channel",)])


def calls(writer, steps):
    """Make the same calls of either writer; yield each message's channel and bytes."""
    writer.start("ros2", "library")
    schema = writer.register_schema("some/msg/Type", "ros2msg", b"float64 x")
    channels = [writer.register_channel(f"/{k}", "cdr", schema, {"k": str(k)}) for k in range(3)]
    counts = defaultdict(int)
    for kind, *values in steps:
        if kind == "flush":
            writer.flush()
        elif kind == "metadata":
            writer.add_metadata("name", {"key": "value"})
        elif kind == "channel":
            channels.append(writer.register_channel("/more", "cdr", schema, {}))
        else:
            k, log_time, publish_time, data = values
            channel = channels[k]
            more = () if isinstance(writer, ChunkedWriter) else (counts[channel],)
            writer.add_message(channel, log_time, data, publish_time, *more)
            counts[channel] += 1
            yield channel, data
    writer.finish()


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [("zstd", CompressionType.ZSTD), ("lz4", CompressionType.LZ4), ("", CompressionType.NONE)],
)
@given(steps=st.lists(MESSAGES | OTHERS, max_size=30), size=st.integers(1, 400))
def test_the_file_is_the_one_that_the_library_writes(ours, theirs, steps, size):
    expected, found = io.BytesIO(), io.BytesIO()
    heads, taken = b"", defaultdict(bytes)

    def take(more, messages):
        nonlocal heads
        heads += more
        for channel, joined in messages.items():
            taken[channel] += joined

    library = Writer(expected, chunk_size=size, compression=theirs, enable_data_crcs=True)
    wanted = defaultdict(bytes)
    for channel, data in calls(library, steps):
        wanted[channel] += data
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunked, "CHUNK_SIZE", size)
        total = sum(1 for _ in calls(ChunkedWriter(found, ours, take), steps))
    assert found.getvalue() == expected.getvalue()
    assert dict(taken) == dict(wanted)
    assert [HEAD.unpack_from(heads, k)[0] for k in range(0, len(heads), HEAD.size)] == [
        Opcode.MESSAGE
    ] * total
