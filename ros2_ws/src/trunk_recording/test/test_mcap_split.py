import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from trunk_recording import digests as module
from trunk_recording.digests import record_offsets, split
from trunk_recording.mcap_file import McapFile
from trunk_recording.messages import HEAD, MessageHead

LENGTH = struct.Struct("<Q")


def walk(data: bytes) -> tuple[list[int], int]:
    """The reference: one record after another."""
    offsets, at = [], 0
    while at + HEAD.size <= len(data):
        end = at + HEAD.size + struct.unpack_from("<Q", data, at + 1)[0]
        if end > len(data):
            break
        offsets.append(at)
        at = end
    return offsets, at


def record(opcode: int, body: bytes) -> bytes:
    return HEAD.pack(opcode, len(body)) + body


def message(
    channel: int, log_time_ns: int, data: bytes, sequence: int = 0, publish_time_ns: int = 0
) -> bytes:
    return record(5, struct.pack("<HIQQ", channel, sequence, log_time_ns, publish_time_ns) + data)


places = st.lists(st.integers(-(2**63), 2**63 - 1) | st.integers(-5, 420), max_size=20)


@settings(max_examples=150)
@given(st.lists(st.integers(0, 40), max_size=60), st.integers(0, 60), places, st.data())
def test_offsets_are_those_of_the_walk(lengths, cut, others, drawn):
    """Whatever an index says: all that is right, some of it, or anything."""
    data = b"".join(record(9, b"\xff" * n) for n in lengths)
    data = data[: max(len(data) - cut, 0)]
    offsets = walk(data)[0]
    some = drawn.draw(st.lists(st.sampled_from(offsets), max_size=60)) if offsets else []
    for indexed in ([], offsets, offsets[::-1], some, others, offsets + others):
        found, end = record_offsets(data, np.array(indexed, np.int64))
        assert (found.tolist(), end) == walk(data)


@given(st.binary(max_size=400), places)
def test_any_bytes_are_split_like_the_walk(data, indexed):
    offsets, end = record_offsets(data, np.array(indexed, np.int64))
    assert (offsets.tolist(), end) == walk(data)


def test_messages_are_grouped_by_channel_and_others_kept_apart():
    parts = [record(3, b"schema")]
    for k in range(500):
        parts += [message(1, k, b"a" * 8), message(2, k, b"b" * (k % 3))]
        if k == 250:
            parts.append(record(4, b"channel"))
    content = split(b"".join(parts))
    assert content.others == [(3, b"schema"), (4, b"channel")]
    assert content.channels[1].log_time_ns.tolist() == list(range(500))
    assert content.channels[2].bytes() == [b"b" * (k % 3) for k in range(500)]
    both = content.messages([1, 2])
    assert both.start.tolist() == sorted(both.start.tolist())
    assert both.log_time_ns.tolist() == np.repeat(np.arange(500), 2).tolist()
    assert content.messages([7]) is None


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (record(5, b"short"), "too short for its header"),
        (message(1, 0, b"")[:-1], "goes beyond its chunk"),
        (record(0, b""), "a record of kind 0x00"),
        (record(8, b"") * (2**18 + 1), "records that are not messages"),
    ],
)
def test_nonsense_is_refused(data, says):
    with pytest.raises(ValueError, match=says):
        split(data)


@pytest.fixture
def walked(monkeypatch):
    """Return the places of the records whose lengths were read one by one."""
    read = []

    class Counting:
        size = LENGTH.size

        def unpack_from(self, data, at):
            read.append(at)
            return LENGTH.unpack_from(data, at)

    monkeypatch.setattr(module, "_LONG", Counting())
    return read


def test_indexed_records_are_nearly_free(walked):
    messages = [message(c, k, b"x" * 100 * c) for k in range(20_000) for c in (1, 2, 3)]
    data = record(4, b"channel").join([b"", *messages[:100], b"".join(messages[100:])])
    expected = np.array(walk(data)[0])
    indexed = expected[np.frombuffer(data, np.uint8)[expected] == 5]
    by_channel = np.concatenate([indexed[c::3] for c in range(3)])
    offsets, end = record_offsets(data, by_channel)
    assert (offsets.tolist(), end) == (expected.tolist(), len(data))
    assert 0 < len(walked) < 250  # the channels, and the message before each


def test_reading_a_file_walks_through_what_no_index_has(tmp_path, walked):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=20_000, enable_data_crcs=True)
        writer.start()
        channels = [writer.register_channel(f"/{i}", "json", 0) for i in range(3)]
        for k in range(5000):
            writer.add_message(channels[k % 3], k, b"x" * (k % 7), k)
        writer.finish()
    file = McapFile(path, {})
    file.scan()
    assert sum(file.counts.values()) == 5000
    assert len(file.blocks) > 5
    assert not file.findings
    assert len(file.blocks) <= len(walked) < 10 * len(file.blocks)
    walked.clear()
    with path.open("rb") as stream:
        content = [file.content(stream, block) for block in file.blocks]
    assert sum(len(messages) for c in content for messages in c.channels.values()) == 5000
    assert len(file.blocks) <= len(walked) < 10 * len(file.blocks)


def test_a_message_knows_its_header():
    records = [message(258, 2**40, b"first", 7, 2**50), message(3, 2**41, b"", 2**31, 2**62)]
    both = split(b"".join(records)).messages([258, 3])
    assert both.head(0) == MessageHead(258, 7, 2**40, 2**50)
    assert both.head(1) == MessageHead(3, 2**31, 2**41, 2**62)
    assert both.channels().tolist() == [258, 3]
    assert both.offsets().tolist() == [0, len(records[0])]
