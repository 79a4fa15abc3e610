"""Columns are filled completely, or not returned at all."""

import pytest
from mcap.opcode import Opcode

from trunk_core.samples import JointSample
from trunk_recording import reader as module
from trunk_recording.cdr import layout_of
from trunk_recording.reader import Recording, RecordingError

from .mcap_files import message, write_mcap

WANTED = {"/a": [("position", "hip")]}
COUNT = 300


def packed(k):
    sample = JointSample(k, ("hip",), (float(k),))
    return layout_of(sample).pack(sample)


def uncompressed(path):
    messages = [("/a", k, packed(k)) for k in range(COUNT)]
    return write_mcap(path, messages, compression="none", enable_crcs=False)


def test_columns_hold_every_message(tmp_path):
    series = Recording.open(uncompressed(tmp_path / "a.mcap")).tables(WANTED)["/a"]
    assert series.column("position", "hip").tolist() == list(range(COUNT))


def without_one(data):
    """Return a file in which one message has become a record of a kind that readers skip."""
    at = data.index(packed(COUNT // 2)) - len(message(1, 0, b""))
    assert data[at] == Opcode.MESSAGE
    return data[:at] + b"\x80" + data[at + 1 :]


def test_an_index_of_more_messages_than_there_are_is_refused(tmp_path, monkeypatch):
    path = uncompressed(tmp_path / "a.mcap")
    path.write_bytes(without_one(path.read_bytes()))
    assert Recording.open(path).topics["/a"].count == COUNT - 1
    monkeypatch.setattr(module, "_BY_SUMMARY", 0)
    glanced = Recording.open_by_summary(path)
    assert not glanced.checked
    assert glanced.topics["/a"].count == COUNT
    with pytest.raises(RecordingError, match=r"a\.mcap: /a has 299 messages, 300 were counted"):
        glanced.tables(WANTED)


def test_a_file_that_has_more_messages_since_it_was_opened_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_KEPT", 0)  # as if it were too long to be kept in memory
    path = uncompressed(tmp_path / "a.mcap")
    whole = path.read_bytes()
    path.write_bytes(without_one(whole))
    recording = Recording.open(path)
    path.write_bytes(whole)
    with pytest.raises(RecordingError, match=r"a\.mcap: /a has 300 messages, 299 were counted"):
        recording.tables(WANTED)


def test_a_short_file_is_read_as_it_was_when_it_was_opened(tmp_path):
    path = uncompressed(tmp_path / "a.mcap")
    recording = Recording.open(path)
    before = Recording.open(path).tables(WANTED)["/a"]
    path.write_bytes(without_one(path.read_bytes()))
    assert len(recording.tables(WANTED)["/a"]) == len(before) == COUNT
