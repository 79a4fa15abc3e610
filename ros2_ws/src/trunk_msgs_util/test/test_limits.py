"""Each limit of `recording/limits.py` is met by a file just beyond it, and not by one just within."""

import pytest
from mcap.records import Metadata

from trunk_msgs_util import topics
from trunk_msgs_util.recording import limits, mcap_file, reader, schemas
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.samples import JointSample

from .mcap_files import channel, chunk, message, record, schema, write_records

TYPE = topics.JOINT_STATE_TYPE
DESCRIBED = schema(1, TYPE) + channel(1, "/a")


def joints(k, names=("hip",), frame=""):
    sample = JointSample(k, names, (0.5,) * len(names))
    if frame:
        layout = layout_of(sample)
        return type(layout)(names, len(names), 0, 0, frame).pack(sample)
    return layout_of(sample).pack(sample)


def opened(path, *parts):
    return Recording.open(write_records(path, DESCRIBED, *parts))


def met(recording):
    """Return what the recording says about the limit that it met; empty if it met none."""
    said = [w for w in recording.warnings if "limit" in w or "is not read" in w]
    assert len(said) < 2
    return "".join(said)


def stored(data):
    return chunk(data, compression="")


@pytest.fixture
def small(monkeypatch):
    """Make the limits of a file small."""
    monkeypatch.setattr(limits, "_FREE_RECORDS", 100)
    monkeypatch.setattr(limits, "_BYTES_A_RECORD", 1 << 40)
    monkeypatch.setattr(limits, "_FREE_BYTES", 20_000)
    monkeypatch.setattr(limits, "_TIMES_SIZE", 0)


@pytest.mark.parametrize(("count", "read"), [(99, 99), (100, 100), (101, 0)])
def test_records(tmp_path, small, count, read):
    recording = opened(tmp_path / "a", stored(message(1, 0, joints(0)) * count))
    assert recording.topics["/a"].count == read
    assert ("more than the 100 records allowed" in met(recording)) == (count > 100)
    assert not recording.complete


def test_bytes_of_all_chunks_together(tmp_path, small):
    one = stored(message(2, 0, bytes(9100)))
    recording = opened(tmp_path / "a", channel(2, "/b", 0), one, one, one)
    assert recording.topics["/b"].count == 2
    assert "unpack to more than the 20000 bytes allowed" in met(recording)
    assert "record at byte 1" in met(recording)


def test_channels(tmp_path):
    many = b"".join(channel(k, f"/t{k}") for k in range(2, limits.MAX_CHANNELS + 1))
    assert not met(opened(tmp_path / "a", many))
    one_more = channel(0, "/more")
    recording = opened(tmp_path / "a", many, one_more, message(1, 0, joints(0)))
    assert f"more than {limits.MAX_CHANNELS} topics" in met(recording)
    assert recording.topics["/a"].count == 0


@pytest.mark.parametrize("more", [0, 1])
def test_the_name_of_a_topic(tmp_path, more):
    name = "/" + "n" * (limits.MAX_NAME - 1 + more)
    recording = opened(tmp_path / "a", channel(2, name))
    assert (name in recording.topics) == (more == 0)
    assert bool(met(recording)) == bool(more)


def test_metadata(tmp_path):
    long = record(Metadata("trunk_provenance", {"key": "v" * limits.MAX_METADATA}))
    assert "bytes of metadata" in met(opened(tmp_path / "a", long))
    others = record(Metadata("another", {"key": "v" * limits.MAX_METADATA}))
    assert not met(opened(tmp_path / "a", others))


def test_joints_of_a_topic(tmp_path):
    def recording(count):
        groups = [tuple(f"j{k}" for k in range(i, i + 8)) for i in range(0, count, 8)]
        return opened(tmp_path / "a", *(message(1, k, joints(k, g)) for k, g in enumerate(groups)))

    assert not met(recording(limits.MAX_JOINTS))
    beyond = recording(limits.MAX_JOINTS + 8)
    assert "name more than 1024 joints" in met(beyond)
    with pytest.raises(RecordingError, match="/a is not read: its messages name more than 1024"):
        beyond.joints("/a")


def test_layouts_of_a_topic(tmp_path):
    def recording(count):
        parts = (message(1, k, joints(k, frame="f" * (k + 1))) for k in range(count))
        return opened(tmp_path / "a", *parts)

    within = recording(limits.MAX_LAYOUTS)
    assert not met(within)
    assert len(within.joints("/a")) == limits.MAX_LAYOUTS
    assert "more than 256 layouts" in met(recording(limits.MAX_LAYOUTS + 1))


def test_the_table_of_a_topic():
    limits.check_table(1 << 11, 1 << 10, 0)
    with pytest.raises(
        limits.LimitError, match="2049 messages by 1024 names has more than the 20971"
    ):
        limits.check_table((1 << 11) + 1, 1 << 10, 0)
    limits.check_table(1 << 20, 64, 8 * 4 << 20)  # each message has four values, of 64 joints


def test_texts(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "MAX_TEXT", 1000)
    event = schemas.event(0, "/simulator", "reset")
    kind = schema(2, topics.DIAGNOSTIC_ARRAY_TYPE)
    described = kind + channel(2, "/run/events", 2)
    fits = 1000 // len(event)
    within = opened(tmp_path / "a", described, message(2, 0, event) * fits)
    assert len(within.events()) == fits
    beyond = opened(tmp_path / "a", described, message(2, 0, event) * (fits + 1))
    assert "/run/events is not read: its messages have more than the 1000 bytes" in met(beyond)
    assert beyond.events() == []


def test_what_is_read_ahead_outside_chunks_is_about_what_is_used(tmp_path, monkeypatch):
    """A message, a channel, a message, a channel: a megabyte used to be read for each."""
    read = []
    original = mcap_file.record_offsets
    monkeypatch.setattr(
        mcap_file, "record_offsets", lambda data: read.append(len(data)) or original(data)
    )
    pair = message(1, 0, joints(0)) + channel(1, "/a")
    recording = opened(tmp_path / "a", pair * 3000)
    assert recording.topics["/a"].count == 3000
    assert sum(read) < 3000 * 5000
