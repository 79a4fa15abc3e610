import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_recording import schemas

pytest.importorskip("rclpy")

from rclpy.serialization import serialize_message

from trunk_msgs_util.node.conversions import (
    WireReader,
    sample_from_ros,
    sample_to_ros,
    sample_to_wire,
    stamp_from_ros,
    stamp_to_ros,
)

doubles = st.floats(allow_nan=False)
values = st.lists(doubles, max_size=3).map(tuple)
samples = st.builds(
    JointSample,
    st.integers(-1, 2**31 * 10**9 - 1),
    st.lists(st.text("abé_/", max_size=5), max_size=3).map(tuple),
    values,
    values,
    values,
)


@given(samples)
def test_a_sample_goes_to_ros_and_back_exactly(sample):
    assert sample_from_ros(sample_to_ros(sample)) == sample


@given(samples, samples)
def test_a_reader_follows_a_stream_whose_layout_changes(first, second):
    read = WireReader()
    for sample in (first, first, second, first):
        assert read(sample_to_wire(sample)) == sample
        assert read(serialize_message(sample_to_ros(sample))) == sample


@given(samples, samples)
def test_a_reader_knows_the_frame_of_the_message_read_last(first, second):
    read = WireReader()
    for sample, frame_id in ((first, "pid@1"), (second, ""), (first, "lqr@2"), (first, "pid@1")):
        assert read(sample_to_wire(sample, frame_id)) == sample
        assert read.frame_id == frame_id
        message = sample_to_ros(sample)
        message.header.frame_id = "camera"
        assert read(serialize_message(message)) == sample
        assert read.frame_id == "camera"
    message = schemas.deserialize(topics.JOINT_STATE_TYPE, sample_to_wire(first, "lqr@2"))
    store = schemas._store()
    assert (
        read(bytes(store.serialize_cdr(message, topics.JOINT_STATE_TYPE, little_endian=False)))
        == first
    )
    assert read.frame_id == "lqr@2"
    read(b"")
    assert read.frame_id == ""


@pytest.mark.parametrize("stamp_ns", [-1, 0, 1, 999_999_999, 10**9, 10**18 + 7])
def test_stamps_are_exact(stamp_ns):
    assert stamp_from_ros(stamp_to_ros(stamp_ns)) == stamp_ns


def test_nan_and_infinity_are_kept():
    sample = JointSample(5, ("a",), (math.inf,), (math.nan,), (-0.0,))
    read = WireReader()(sample_to_wire(sample))
    assert read.position == (math.inf,)
    assert math.isnan(read.velocity[0])
    assert math.copysign(1.0, read.effort[0]) == -1.0


@given(st.binary(max_size=200))
def test_bytes_that_are_not_a_message_raise_nothing(data):
    sample = WireReader()(data)
    assert isinstance(sample, JointSample)


def test_a_cut_message_has_no_names():
    data = sample_to_wire(JointSample(5, ("hip", "trunk"), (1.0, 2.0)))
    assert WireReader()(data[:-20]) == JointSample(-1, ())
