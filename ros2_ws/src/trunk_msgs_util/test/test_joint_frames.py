"""A message's frame, in real time its source, goes with it through everything that reads a topic."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_msgs_util import topics
from trunk_msgs_util.recording import joint_arrays, schemas
from trunk_msgs_util.recording.columns import ColumnLoader
from trunk_msgs_util.recording.joint_arrays import JointArrays, concatenate, decode
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.recording.messages import Messages
from trunk_msgs_util.samples import JointSample

NAMES = ("hip", "trunk")
FRAMES = ("pid@boot.1.2", "lqr@boot.3.4", "", "pid@boot.5.6")
NO_VALUES = np.empty((3, 0))
frames = st.lists(st.sampled_from(FRAMES), min_size=1, max_size=30)


def message(k: int, frame: str, names: tuple[str, ...] = NAMES) -> bytes:
    return layout_of(s := JointSample(k, names, (float(k),) * len(names)), frame).pack(s)


def big_endian(k: int, frame: str) -> bytes:
    m = schemas.deserialize(topics.JOINT_STATE_TYPE, message(k, frame))
    return bytes(schemas._store().serialize_cdr(m, topics.JOINT_STATE_TYPE, little_endian=False))


def joined(parts: list[bytes]) -> Messages:
    end = np.cumsum([len(part) for part in parts])
    start = end - [len(part) for part in parts]
    return Messages(b"".join(parts), np.arange(len(parts)) + 7, start, end)


def frames_of(arrays: JointArrays | ColumnLoader) -> list[str]:
    return [arrays.frames[place] for place in arrays.frame.tolist()]


def loaded(drawn: list[str], block: int, values: bool = True) -> ColumnLoader:
    loader = ColumnLoader(len(drawn), values)
    parts = [message(k, frame) for k, frame in enumerate(drawn)]
    for first in range(0, len(parts), block):
        loader.take(joined(parts[first : first + block]))
    return loader


@given(frames)
def test_each_message_has_its_frame(drawn):
    arrays = decode(joined([message(k, frame) for k, frame in enumerate(drawn)]))
    assert frames_of(arrays) == drawn
    assert arrays.stamp_ns.tolist() == list(range(len(drawn)))
    assert sorted(arrays.frames) == sorted(set(drawn))


@given(frames, st.data())
def test_rows_keep_their_frames(drawn, data):
    arrays = decode(joined([message(k // 2, frame) for k, frame in enumerate(drawn)]))
    rows = data.draw(st.lists(st.integers(0, len(drawn) - 1)))
    assert frames_of(arrays.rows(np.array(rows, np.int64))) == [drawn[row] for row in rows]
    assert frames_of(arrays.by_stamp()) == drawn[::2]


@given(st.lists(frames, max_size=4))
def test_parts_keep_their_frames(drawn):
    parts = [decode(joined([message(k, f) for k, f in enumerate(part)])) for part in drawn]
    assert frames_of(concatenate(parts)) == [frame for part in drawn for frame in part]


def test_a_big_endian_message_has_its_frame():
    arrays = decode(joined([message(0, "a@1"), big_endian(1, "b@2"), big_endian(2, "a@1")]))
    assert frames_of(arrays) == ["a@1", "b@2", "a@1"]
    with pytest.raises(ValueError, match="not a little-endian"):
        decode(joined([message(0, ""), big_endian(1, "x" * 1025)]))


def test_one_frame_takes_no_memory():
    stamps = np.arange(3)
    for arrays in (
        JointArrays(NAMES, stamps, stamps, NO_VALUES, NO_VALUES, NO_VALUES),
        decode(joined([message(k, "pid@1") for k in range(3)])),
        loaded(["pid@1"] * 3, 2).arrays(stamps, stamps),
    ):
        assert arrays is not None
        assert arrays.frame.strides == (0,)
        assert len(arrays.frames) == 1
        assert frames_of(arrays) == frames_of(arrays.rows(np.array([2, 0, 1])))
    assert frames_of(concatenate([])) == []


@given(frames, st.integers(1, 7), st.booleans())
def test_a_topic_filled_in_passing_has_its_frames(drawn, block, values):
    loader = loaded(drawn, block, values)
    assert loader.whole
    assert frames_of(loader) == drawn
    arrays = loader.arrays(*loader.times(None))
    assert (arrays is not None) == values
    if arrays is not None:
        whole = decode(joined([message(k, frame) for k, frame in enumerate(drawn)]))
        assert frames_of(arrays) == drawn
        assert arrays.position.tobytes() == whole.position.tobytes()
        assert arrays.stamp_ns.tolist() == whole.stamp_ns.tolist()


@pytest.mark.parametrize(
    "other", [message(2, "b@2", ("trunk", "hip")), message(2, "b@2", ("hip",))]
)
def test_other_names_are_not_filled_in_passing(other):
    loader = ColumnLoader(3, values=True)
    loader.take(joined([message(0, "a@1"), message(1, "b@2"), other]))
    assert not loader.whole


def test_another_byte_order_makes_no_difference():
    little = [message(0, "a@1"), message(1, "b@2")]
    loaders = [ColumnLoader(3, values=True) for _ in range(2)]
    loaders[0].take(joined([*little, message(2, "a@1")]))
    loaders[1].take(joined([*little, big_endian(2, "a@1")]))
    assert loaders[1].whole
    assert frames_of(loaders[0]) == frames_of(loaders[1])
    columns = [loader.arrays(*loader.times(None)) for loader in loaders]
    assert columns[0].position.tobytes() == columns[1].position.tobytes()
    assert columns[0].stamp_ns.tolist() == columns[1].stamp_ns.tolist()


def test_a_topic_of_too_many_frames_is_not_filled_in_passing(monkeypatch):
    monkeypatch.setattr(joint_arrays, "MAX_LAYOUTS", 3)
    assert loaded(["a", "b", "c"] * 2, 6).whole
    assert not loaded(["a", "b", "c", "d"], 4).whole
