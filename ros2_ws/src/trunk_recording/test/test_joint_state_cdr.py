import struct

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from trunk_core.samples import JointSample
from trunk_recording.cdr import JointStateLayout, layout_of

TYPE = "sensor_msgs/msg/JointState"
STORE = get_typestore(Stores.ROS2_JAZZY)
NAN_WITH_PAYLOAD = struct.unpack("<d", bytes.fromhex("efbeadde0000f87f"))[0]

# ROS strings end at a NUL.
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)
doubles = st.lists(st.floats(width=64), max_size=5).map(tuple)
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
samples = st.builds(
    JointSample, stamps, st.lists(texts, max_size=4).map(tuple), doubles, doubles, doubles
)


def by_rosbags(sample: JointSample, frame_id: str = "") -> bytes:
    types = STORE.types
    sec, nanosec = divmod(sample.stamp_ns, 10**9)
    message = types[TYPE](
        types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](sec, nanosec), frame_id),
        list(sample.name),
        *(np.array(values, np.float64) for values in sample[2:]),
    )
    return bytes(STORE.serialize_cdr(message, TYPE, little_endian=True))


def bits(sample: JointSample) -> tuple[object, ...]:
    """Comparable to the last bit: NaN equals itself, -0.0 differs from 0.0."""
    return (*sample[:2], *(struct.pack(f"{len(v)}d", *v) for v in sample[2:]))


@given(samples, texts)
@example(JointSample(0, ("hip", "trunk"), (1.0, -0.0), (), (float("inf"), NAN_WITH_PAYLOAD)), "")
def test_bytes_equal_those_of_rosbags_and_round_trip_to_the_bit(sample, frame_id):
    layout = JointStateLayout(sample.name, *map(len, sample[2:]), frame_id=frame_id)
    data = layout.pack(sample)
    assert data == by_rosbags(sample, frame_id)
    assert JointStateLayout.parse(data) == layout
    assert bits(layout.unpack(data)) == bits(sample)


@given(samples)
def test_rclpy_reads_what_is_packed_and_the_reverse(sample):
    serialization = pytest.importorskip("rclpy.serialization")
    messages = pytest.importorskip("sensor_msgs.msg")
    layout = layout_of(sample)
    read = serialization.deserialize_message(layout.pack(sample), messages.JointState)
    values = (tuple(read.position), tuple(read.velocity), tuple(read.effort))
    stamp_ns = read.header.stamp.sec * 10**9 + read.header.stamp.nanosec
    assert bits(JointSample(stamp_ns, tuple(read.name), *values)) == bits(sample)
    # Their bytes may differ in padding and tail, which rmw leaves as it finds them.
    theirs = serialization.serialize_message(read)
    assert JointStateLayout.parse(theirs) == layout
    assert bits(layout.unpack(theirs)) == bits(sample)


@given(samples, st.lists(stamps, min_size=1, max_size=20))
def test_bulk_decoding_equals_one_by_one(sample, times):
    layout = layout_of(sample)
    messages = [layout.pack(sample._replace(stamp_ns=t)) for t in times]
    array = layout.decode_at(b"".join(messages), layout.size * np.arange(len(messages)))
    assert array.dtype.itemsize == layout.size == len(messages[0])
    for row, message in zip(array, messages, strict=True):
        values = (tuple(row[q].tolist()) for q in ("position", "velocity", "effort"))
        stamp_ns = int(row["sec"]) * 10**9 + int(row["nanosec"])
        assert bits(JointSample(stamp_ns, sample.name, *values)) == bits(layout.unpack(message))


@pytest.mark.parametrize(
    "other",
    [
        JointSample(0, ("hip", "trink"), (1.0, 2.0), (3.0, 4.0), (5.0, 6.0)),
        JointSample(0, ("trunk", "hip"), (1.0, 2.0), (3.0, 4.0), (5.0, 6.0)),
        JointSample(0, ("hip", "trunk"), (1.0, 2.0), (), (5.0, 6.0)),
        JointSample(0, ("hip", "trunk"), (1.0, 2.0, 0.0), (3.0,), (5.0, 6.0)),
    ],
    ids=["another name", "another order", "no velocity", "as many values, otherwise spread"],
)
def test_another_layout_is_refused(other):
    sample = JointSample(0, ("hip", "trunk"), (1.0, 2.0), (3.0, 4.0), (5.0, 6.0))
    layout = layout_of(sample)
    packed = layout_of(other).pack(other)
    for refused in (
        lambda: layout.pack(other),
        lambda: layout.unpack(packed),
        lambda: layout.decode_at(layout.pack(sample) + packed, np.array([0, layout.size])),
    ):
        with pytest.raises(ValueError, match=r"layout|size"):
            refused()


@pytest.mark.parametrize("frame_id", ["", "base_of_the_trunk"])
@pytest.mark.parametrize(
    "name", [("trunk",), ("hip", "trunk"), ("a" * 40, "b"), ("left_hip_joint", "knee", "c")]
)
def test_every_reader_notices_every_altered_byte_that_the_layout_fixes(name, frame_id):
    values = tuple(1.0 + i for i in range(len(name)))
    sample = JointSample(1_500_000_000, name, values, (), values)
    layout = JointStateLayout(name, len(name), 0, len(name), frame_id)
    packed = layout.pack(sample)
    free = {2, 3, *range(4, 12)}  # options of the encapsulation, stamp
    for field in ("position", "effort"):
        at = layout.dtype.fields[field][1]
        free |= set(range(at, at + 8 * len(name)))
    refused = 0
    for at in set(range(len(packed))) - free:
        altered = bytearray(packed)
        altered[at] ^= 0x01
        readers = (
            layout.unpack,
            lambda data: layout.decode_at(packed + data, np.array([0, len(packed)])),
        )
        fits = layout.fits(packed + bytes(altered), np.array([0, len(packed)])).tolist()
        if says_the_same(bytes(altered), packed):  # padding
            assert fits == [True, True]
            for read in readers:
                read(bytes(altered))
            continue
        refused += 1
        assert fits == [True, False]
        for read in readers:
            with pytest.raises(ValueError, match="layout"):
                read(bytes(altered))
    assert refused >= sum(map(len, name)) + len(frame_id)


def says_the_same(data, other):
    """Return True if rosbags reads the same of both messages; it looks at the byte order alone."""
    if data[:2] != other[:2]:
        return False
    try:
        one, two = (STORE.deserialize_cdr(each, TYPE) for each in (data, other))
    except Exception:  # whatever it raises on an altered message
        return False
    return bytes(STORE.serialize_cdr(one, TYPE)) == bytes(STORE.serialize_cdr(two, TYPE))


@given(samples, st.data())
def test_a_cut_or_altered_message_raises_nothing_but_value_error(sample, data):
    packed = layout_of(sample).pack(sample)
    cut = data.draw(st.integers(0, len(packed) - 1))
    with pytest.raises(ValueError, match=r"\w"):
        JointStateLayout.parse(packed[:cut])
    altered = bytearray(packed)
    altered[data.draw(st.integers(0, len(packed) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        layout = JointStateLayout.parse(bytes(altered))
    except ValueError:
        return
    assert layout.size <= len(altered)
    layout.unpack(bytes(altered))


@pytest.mark.parametrize("at", [12, 20, 24, 28, 32], ids=["frame", "names", "p", "v", "e"])
def test_a_count_beyond_the_message_raises_at_once(at):
    data = bytearray(layout_of(JointSample(0, ())).pack(JointSample(0, ())))
    data[at : at + 4] = b"\xff\xff\xff\xff"
    with pytest.raises(ValueError, match=r"ends before|terminator"):
        JointStateLayout.parse(bytes(data))


def test_a_big_endian_message_is_refused():
    with pytest.raises(ValueError, match="little-endian"):
        JointStateLayout.parse(b"\x00\x00\x00\x00" + bytes(40))


def test_a_stamp_beyond_the_message_is_refused():
    sample = JointSample(2**31 * 10**9, ())
    with pytest.raises(ValueError, match="cannot be packed"):
        layout_of(sample).pack(sample)


def test_a_layout_is_made_once():
    first, second = (JointSample(t, ("a",), (float(t),)) for t in range(2))
    assert layout_of(first) is layout_of(second)
    assert layout_of(first, "pid@1") is layout_of(second, "pid@1")
    assert layout_of(first, "pid@1") == JointStateLayout(("a",), 1, frame_id="pid@1")
