"""A message's frame, in real time its source, goes with it through everything that reads a topic."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.samples import JointSample
from trunk_recording import joint_table
from trunk_recording.cdr import layout_of
from trunk_recording.joint_table import Filling, JointTable, UnreadableError
from trunk_recording.messages import Messages

NAMES = ("hip", "trunk")
FRAMES = ("pid@boot.1.2", "lqr@boot.3.4", "", "pid@boot.5.6")
OTHERS = (NAMES, ("trunk", "hip"), ("hip",), ("other", "trunk"))
frames = st.lists(st.sampled_from(FRAMES), min_size=1, max_size=30)
messages = st.lists(st.tuples(st.sampled_from(FRAMES), st.sampled_from(OTHERS)), min_size=1)


def message(k: int, frame: str, names: tuple[str, ...] = NAMES) -> bytes:
    values = tuple(float(k + place) for place in range(len(names)))
    return layout_of(s := JointSample(k, names, values), frame).pack(s)


def joined(parts: list[bytes]) -> Messages:
    end = np.cumsum([len(part) for part in parts])
    start = end - [len(part) for part in parts]
    return Messages(b"".join(parts), np.arange(len(parts)) + 7, start, end)


def frames_of(table: JointTable) -> list[str]:
    return [table.frames[place] for place in table.frame.tolist()]


def filled(parts: list[bytes], block: int = 1000, only=None) -> JointTable:
    filling = Filling(only)
    for first in range(0, len(parts), block):
        filling.take(joined(parts[first : first + block]))
    return filling.table("", "")


@given(messages, st.integers(1, 7))
def test_each_message_has_its_frame_and_its_values(drawn, block):
    table = filled([message(k, *one) for k, one in enumerate(drawn)], block)
    assert frames_of(table) == [frame for frame, _ in drawn]
    assert sorted(table.frames) == sorted({frame for frame, _ in drawn})
    assert table.stamp_ns.tolist() == list(range(len(drawn)))
    assert table.names == tuple(dict.fromkeys(name for _, names in drawn for name in names))
    for name in table.names:
        expected = [
            k + names.index(name) if name in names else np.nan for k, (_, names) in enumerate(drawn)
        ]
        assert np.array_equal(table.column("position", name), expected, equal_nan=True)


@given(messages, st.integers(1, 7), st.sampled_from(NAMES))
def test_one_column_is_that_of_all(drawn, block, name):
    parts = [message(k, *one) for k, one in enumerate(drawn)]
    alone, every = filled(parts, block, [("position", name)]), filled(parts, block)
    assert set(alone.names) <= {name}
    assert alone.column("position", name).tobytes() == every.column("position", name).tobytes()
    assert frames_of(alone) == frames_of(every)


@given(frames, st.data())
def test_rows_keep_their_frames(drawn, data):
    table = filled([message(k // 2, frame) for k, frame in enumerate(drawn)])
    rows = data.draw(st.lists(st.integers(0, len(drawn) - 1)))
    assert frames_of(table.rows(np.array(rows, np.int64))) == [drawn[row] for row in rows]
    assert frames_of(table.by_stamp()) == drawn[::2]


def test_one_frame_takes_no_memory():
    table = filled([message(k, "pid@1") for k in range(3)])
    assert table.frame.strides == (0,)
    assert len(table.frames) == 1
    assert frames_of(table) == frames_of(table.rows(np.array([2, 0, 1])))
    assert frames_of(filled([])) == []


@pytest.mark.parametrize("row", [0, 1, 2])
def test_a_message_of_another_byte_order_is_named(row):
    parts = [message(k, "a@1") for k in range(3)]
    parts[row] = b"\0\0" + parts[row][2:]
    with pytest.raises(UnreadableError, match="not a little-endian") as caught:
        filled(parts)
    assert caught.value.row == row


def test_a_block_of_too_many_layouts_is_refused(monkeypatch):
    monkeypatch.setattr(joint_table, "MAX_LAYOUTS", 3)
    assert len(filled([message(k, frame) for k, frame in enumerate("abc" * 2)])) == 6
    with pytest.raises(UnreadableError, match="more than 3 layouts"):
        filled([message(k, frame) for k, frame in enumerate("abcd")])
