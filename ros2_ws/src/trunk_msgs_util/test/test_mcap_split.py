import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trunk_msgs_util.recording import content as module
from trunk_msgs_util.recording.content import record_offsets, split
from trunk_msgs_util.recording.messages import HEAD, MessageHead

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


lengths = st.integers(0, 40)
# Stretches of periods, so that regular and irregular parts follow one another.
stretches = st.lists(
    st.tuples(st.lists(lengths, min_size=1, max_size=70), st.integers(1, 400)), max_size=4
)


@settings(max_examples=150)
@given(stretches, st.integers(0, 60))
def test_offsets_are_those_of_the_walk(stretches, cut):
    records = [record(9, b"\xff" * n) for period, times in stretches for n in period * times]
    data = b"".join(records)
    data = data[: max(len(data) - cut, 0)]
    offsets, end = record_offsets(data)
    assert (offsets.tolist(), end) == walk(data)


@given(st.binary(max_size=400))
def test_any_bytes_are_split_like_the_walk(data):
    offsets, end = record_offsets(data)
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
        def unpack_from(self, data, at):
            read.append(at)
            return LENGTH.unpack_from(data, at)

    monkeypatch.setattr(module, "_LONG", Counting())
    return read


def test_regular_records_are_nearly_free(walked):
    data = b"".join(message(c, k, b"x" * 100 * c) for k in range(20_000) for c in (1, 2, 3))
    offsets, end = record_offsets(data)
    assert (len(offsets), end) == (60_000, len(data))
    assert 0 < len(walked) < 600  # by one by one


def test_nearly_regular_records_are_not_slow(walked, monkeypatch):
    """Each length is compared about once, whether one by one or many at a time."""
    compared, find = [], np.flatnonzero
    monkeypatch.setattr(np, "flatnonzero", lambda wrong: compared.append(len(wrong)) or find(wrong))
    regular = b"".join(record(9, b"") for _ in range(300))
    data = (regular + record(9, b"x")) * 3000  # many beginnings of periods
    offsets, _ = record_offsets(data)
    assert len(offsets) == 301 * 3000
    assert len(walked) + sum(compared) < 1.5 * len(offsets)


def test_a_message_knows_its_header():
    records = [message(258, 2**40, b"first", 7, 2**50), message(3, 2**41, b"", 2**31, 2**62)]
    both = split(b"".join(records)).messages([258, 3])
    assert both.head(0) == MessageHead(258, 7, 2**40, 2**50)
    assert both.head(1) == MessageHead(3, 2**31, 2**41, 2**62)
    assert both.channels().tolist() == [258, 3]
    assert both.offsets().tolist() == [0, len(records[0])]
