"""What a file unpacks to, and what is made of it, is bounded; what is read ahead is about what is used."""

import pytest

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_recording import joint_table, mcap_file, messages, reader, schemas
from trunk_recording.cdr import layout_of
from trunk_recording.reader import Recording, RecordingError

from .mcap_files import channel, chunk, message, raw, schema, start, write_records

TYPE = topics.JOINT_STATE_TYPE
DESCRIBED = schema(1, TYPE) + channel(1, "/a")


def joints(k, names=("hip",)):
    sample = JointSample(k, names, (0.5,) * len(names))
    return layout_of(sample).pack(sample)


def opened(path, *parts):
    return Recording.open(write_records(path, DESCRIBED, *parts))


def test_a_file_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    one = chunk(message(1, 0, joints(0)) * 1000)
    assert opened(tmp_path / "a", one, one).topics["/a"].count == 2000
    monkeypatch.setattr(mcap_file, "allowed", lambda size: 150_000)
    with pytest.raises(RecordingError, match="a is too large to be read: more than 150000 bytes"):
        opened(tmp_path / "a", one, one)


def test_a_record_that_claims_too_much_is_not_read(tmp_path):
    path, length = tmp_path / "a", messages.LIMIT + 1
    path.write_bytes(start("foreign") + raw(4, length=length))
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size + length)  # of zeros, which take no room on the disk
    warning, *_ = Recording.open(path).warnings
    assert f"claims {length} bytes, more than the {messages.LIMIT} that are read" in warning


def test_a_file_of_too_many_channels_is_refused(tmp_path):
    many = [channel(k, f"/t{k}") for k in range(2, 4097)]
    assert len(opened(tmp_path / "a", *many).topics) == 4096
    with pytest.raises(RecordingError, match=r"a is too large to be read: .* 4096 channels"):
        opened(tmp_path / "a", *many, channel(4097, "/more"))


def test_what_a_file_may_unpack_to_depends_on_its_size():
    assert messages.allowed(1) == messages.LIMIT == 128 << 20
    assert messages.allowed(1 << 20) == 256 << 20


def test_a_table_of_ever_other_names_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(joint_table, "LIMIT", 100_000)
    parts = [message(1, k, joints(k, (f"j{k}",))) for k in range(250)]
    with pytest.raises(RecordingError, match=r"/a cannot be read .* by .* names are more than is"):
        opened(tmp_path / "a", *(chunk(part) for part in parts)).joints("/a")
    with pytest.raises(RecordingError, match=r"/a is too large: .* names are more than is read"):
        Recording.open(tmp_path / "a", whole=True)
    assert len(opened(tmp_path / "a", *parts[:99]).joints("/a").names) == 99


def test_a_long_table_of_always_the_same_names_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(joint_table, "LIMIT", 10_000)
    parts = [chunk(message(1, k, joints(k, tuple("abcdef")))) for k in range(250)]
    assert opened(tmp_path / "a", *parts).joints("/a").position.shape == (250, 6)


def test_texts(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "_TEXT", 1000)
    event = schemas.event(0, "/simulator", "reset")
    described = schema(2, topics.DIAGNOSTIC_ARRAY_TYPE) + channel(2, "/run/events", 2)
    fits = 1000 // len(event)
    assert (
        len(opened(tmp_path / "a", described, message(2, 0, event) * fits).events("/run/events"))
        == fits
    )
    beyond = opened(tmp_path / "a", described, message(2, 0, event) * (fits + 1))
    assert beyond.events("/run/events") == []
    assert "/run/events is not read: its messages have more than the 1000 bytes that are read" in (
        beyond.warnings
    )


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
