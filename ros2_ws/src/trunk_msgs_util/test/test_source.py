"""The text that names a message's node and process, and what a stranger's frame is not taken for."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.samples import JointSample
from trunk_msgs_util.source import (
    frame_of_inputs,
    process_id,
    process_of,
    source,
    source_in,
    sources_of_inputs,
)
from trunk_recording.cdr import MAX_NAME, frame_in, layout_of

PID, PLANT = source("pid", "boot.3.4"), source("simulator", "boot.1.2")
LONGEST = source("n" * 240, "p" * 98)
sources = st.sampled_from(["", PID, PLANT, source("a", ""), LONGEST])


def test_a_source_is_found_in_its_frame():
    own = source("pid", process_id())
    assert source_in(own) == own
    assert process_of(own) == process_id()
    assert process_of("") == ""


@pytest.mark.parametrize(
    "frame",
    ["", "-", "base_link", "pid", "@", "@boot.1.2", "pid @boot", "pid@boot 1", "pid@a@b", "3d@x",
     "pid@é", "pid@a\n", "/pid@a", "p" * 256 + "@x", "pid@" + "x" * 300],
)  # fmt: skip
def test_a_strangers_frame_is_no_source(frame):
    assert source_in(frame) == ""


@given(sources, sources, sources)
def test_a_rows_frame_names_three_sources(simulator, command, disturbance):
    frame = frame_of_inputs(simulator, command, disturbance)
    assert sources_of_inputs(frame) == (simulator, command, disturbance)
    assert len(frame) <= MAX_NAME


@pytest.mark.parametrize(
    "frame", ["", "-", PID, f"{PID} {PID}", f"{PID} - - -", f"{PID}  -", "a b c", f"{PID} - "]
)
def test_any_other_frame_is_no_rows(frame):
    assert sources_of_inputs(frame) is None


texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=30)


@given(texts, st.integers(0, 10**18))
def test_the_frame_is_read_without_the_layout(frame, stamp_ns):
    sample = JointSample(stamp_ns, ("hip", "trunk"), (1.0, 2.0))
    assert frame_in(layout_of(sample, frame).pack(sample)) == frame


@given(st.binary(max_size=60))
def test_other_bytes_have_no_frame_and_raise_nothing(data):
    assert isinstance(frame_in(data), str)
    assert isinstance(frame_in(b"\x00\x01\x00\x00" + data), str)
