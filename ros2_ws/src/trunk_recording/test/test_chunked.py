"""Chunks by `ChunkedWriter` and by the library's writer: the same file, byte for byte."""

import io
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from trunk_recording.messages import MESSAGE_HEAD
from trunk_recording.writer import ChunkedWriter, Rows

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


@pytest.mark.slow
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
        patch.setattr("trunk_recording.writer.CHUNK_SIZE", size)
        total = sum(1 for _ in calls(ChunkedWriter(found, ours, take), steps))
    assert found.getvalue() == expected.getvalue()
    assert dict(taken) == dict(wanted)
    assert [
        MESSAGE_HEAD.unpack_from(heads, k)[0] for k in range(0, len(heads), MESSAGE_HEAD.size)
    ] == [Opcode.MESSAGE] * total


# A channel's messages in a block: how long each is, and in which places they are.
BLOCK = st.dictionaries(
    st.integers(0, 2), st.tuples(st.integers(1, 60), st.sets(st.integers(0, 20), min_size=1))
)


@pytest.mark.slow
@given(blocks=st.lists(BLOCK, max_size=5), size=st.integers(1, 800), seed=st.integers(0, 9))
def test_rows_make_the_file_of_single_messages(blocks, size, seed):
    rng = np.random.default_rng(seed)
    one_by_one, in_rows = io.BytesIO(), io.BytesIO()
    taken = [defaultdict(bytes), defaultdict(bytes)]
    writers = []
    for stream, found in zip((one_by_one, in_rows), taken, strict=True):

        def take(heads, messages, found=found):
            for channel, joined in {0: heads, **messages}.items():
                found[channel] += joined

        writers.append(ChunkedWriter(stream, "", take))
    first, second = writers
    for writer in writers:
        writer.start("ros2", "library")
        schema = writer.register_schema("some/msg/Type", "ros2msg", b"float64 x")
        for k in range(3):
            writer.register_channel(f"/{k}", "cdr", schema, {"k": str(k)})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("trunk_recording.writer.CHUNK_SIZE", size)
        for block in blocks:
            rows, messages = [], []
            for k, (length, places) in block.items():
                data = np.frombuffer(rng.bytes(length * len(places)), f"V{length}")
                times = rng.integers(0, 2**62, len(places))
                rows.append(Rows(k + 1, np.array(sorted(places)), times, data))
                messages += [
                    (place, len(rows), k + 1, time, one.tobytes())
                    for place, time, one in zip(sorted(places), times.tolist(), data, strict=True)
                ]
            second.add_rows(rows)
            in_order = sorted(messages, key=lambda one: (one[0], by_first(rows, one[1] - 1)))
            for _, _, channel, time, data in in_order:
                first.add_message(channel, time, data, time)
        for writer in writers:
            writer.finish()
    assert in_rows.getvalue() == one_by_one.getvalue()
    assert taken[0] == taken[1]


def by_first(rows, i):
    """Return the order of rows with messages in the same place: the one that begins first, then the first."""
    return int(rows[i].place[0]), i
