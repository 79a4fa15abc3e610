import struct

import pytest
from mcap.opcode import Opcode
from mcap.writer import IndexType

from trunk_core.samples import JointSample
from trunk_recording import reader as module
from trunk_recording.cdr import layout_of
from trunk_recording.mcap_file import McapFile
from trunk_recording.reader import Recording
from trunk_recording.summary import open_by_summary

from .mcap_files import records_of, write_mcap


def messages(steps=300):
    for k in range(steps):
        t = k * 1_000_000 + (k > 100) * 7_000_000
        for topic, names in (("/a", ("hip",)), ("/b", ("hip", "trunk"))):
            sample = JointSample(t, names, tuple(map(float, range(len(names)))))
            if topic == "/a" or k % 3 == 0:
                yield topic, t + 5, layout_of(sample).pack(sample)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_glance_agrees_with_a_scan(tmp_path, compression, monkeypatch):
    path = write_mcap(tmp_path / "a.mcap", messages(), compression=compression)
    monkeypatch.setattr(McapFile, "scan", None)  # would raise
    monkeypatch.setattr(module, "_BY_SUMMARY", 0)
    seen = Recording.open_by_summary(path)
    monkeypatch.undo()
    scanned = Recording.open(path)
    assert (seen.checked, scanned.checked) == (False, True)
    assert {n: (t.count, t.first_stamp_ns, t.last_stamp_ns) for n, t in seen.topics.items()} == {
        n: (t.count, t.first_stamp_ns, t.last_stamp_ns) for n, t in scanned.topics.items()
    }
    assert seen.library == scanned.library == "foreign"
    assert seen.joints("/b").position.tolist() == scanned.joints("/b").position.tolist()


def test_a_recording_of_ours_is_known_at_a_glance(run_file, monkeypatch):
    path = run_file.write(400, parameters={"max_effort": 5.0}, flush_every=50)
    monkeypatch.setattr(module, "_BY_SUMMARY", 0)
    seen = Recording.open_by_summary(path)
    assert not seen.checked
    assert seen.complete
    assert seen.provenance["scenario"] == "fig6"
    (given,) = seen.parameter_messages("/run/parameters")
    assert (given.node, given.new) == ("/simulator", {"max_effort": 5.0})
    assert {name: topic.count for name, topic in seen.topics.items() if topic.count} == {
        name: topic.count for name, topic in Recording.open(path).topics.items() if topic.count
    }


def test_short_files_are_scanned(run_file):
    assert Recording.open_by_summary(run_file.write(20)).checked


@pytest.mark.parametrize(
    "options",
    [{"index_types": IndexType.NONE}, {"use_statistics": False}, {"use_chunking": False}],
    ids=str,
)
def test_without_an_index_there_is_no_glance(tmp_path, options):
    path = write_mcap(tmp_path / "a.mcap", messages(), **options)
    assert open_by_summary(path, {}) is None


def statistics_count(data, channel):
    """Return where the statistics of a file have a channel's count of messages."""
    at = next(at for opcode, at, _ in records_of(data) if opcode == Opcode.STATISTICS)
    entries = at + 9 + struct.calcsize("<QHIIIIQQI")
    size = struct.calcsize("<HQ")
    return next(
        at + 2
        for at in range(entries, len(data), size)
        if struct.unpack_from("<H", data, at)[0] == channel
    )


def test_counts_that_cannot_be_are_not_trusted(tmp_path):
    """The rest of the summary fits, and it has no checksum."""
    path = write_mcap(tmp_path / "a.mcap", messages(), enable_crcs=False)
    data = bytearray(path.read_bytes())
    assert open_by_summary(path, {}) is not None
    at = statistics_count(data, channel=1)
    assert struct.unpack_from("<Q", data, at) == (300,)
    for count in (0, 301, 2**63):
        struct.pack_into("<Q", data, at, count)
        path.write_bytes(data)
        assert open_by_summary(path, {}) is None
    assert Recording.open(path).topics["/a"].count == 300


def test_a_summary_that_does_not_fit_is_not_trusted(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", messages())
    data = path.read_bytes()
    assert open_by_summary(path, {}) is not None
    start = struct.unpack_from("<Q", data, len(data) - 8 - 20)[0]
    for at in (*range(start, len(data), 7), len(data) - 1):
        altered = bytearray(data)
        altered[at] ^= 0x10
        path.write_bytes(altered)
        assert open_by_summary(path, {}) is None, at
    for size in (0, 5, 40, start, len(data) - 9):
        path.write_bytes(data[:size])
        assert open_by_summary(path, {}) is None
