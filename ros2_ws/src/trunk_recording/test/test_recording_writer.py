import hashlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

from trunk_core import topics
from trunk_recording.digests import DIGESTS, differing
from trunk_recording.reader import Recording
from trunk_recording.writer import END, PROVENANCE, RecordingWriter

TRUTH = f"/{topics.GROUND_TRUTH}"


def test_mcap_reads_it_with_all_checksums(run_file):
    path = run_file.write(20, flush_every=5)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        counts = reader.get_summary().statistics.channel_message_counts
        assert sum(counts.values()) == len(list(reader.iter_messages())) == 3 * 21 + 11 + 1
        provenance, _, end, digests = ((m.name, m.metadata) for m in reader.iter_metadata())
        assert provenance == (PROVENANCE, {"scenario": "fig6", "host": "größe"})
        assert end == (END, {"complete": "true", "reason": "finished"})
        truth = hashlib.blake2b(digest_size=32)
        for _, _, message in reader.iter_messages(TRUTH):
            truth.update(message.data)
        assert digests[0] == DIGESTS
        assert digests[1][TRUTH] == truth.hexdigest()
        sequences = [m.sequence for _, c, m in reader.iter_messages(TRUTH)]
        assert sequences == list(range(21))


def test_every_checksum_is_there(run_file):
    path = run_file.write(20)
    data = bytearray(path.read_bytes())
    data[data.index(b"fig6")] ^= 1  # outside all chunks: only the data section's checksum covers it
    path.write_bytes(data)
    with path.open("rb") as file, pytest.raises((ValueError, McapError), match="crc"):
        list(NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False))


def test_mcap_ros2_decodes_it(run_file):
    decoder = pytest.importorskip("mcap_ros2.decoder")
    with run_file.write(4, parameters={"max_effort": 5.0}).open("rb") as file:
        reader = make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        decoded = [m.decoded_message for m in reader.iter_decoded_messages(TRUTH)]
        assert [list(m.position) for m in decoded] == [[k, k + 0.25] for k in range(5)]
        assert decoded[3].header.stamp.nanosec == 3 * run_file.period_ns
        (event,) = reader.iter_decoded_messages(f"/{topics.RUN_EVENTS}")
        assert event.decoded_message.status[0].message == "started"
        (told,) = reader.iter_decoded_messages(f"/{topics.RUN_PARAMETERS}")
        assert told.decoded_message.new_parameters[0].value.double_value == 5.0


def test_rosbags_reads_it(run_file):
    path = run_file.write(4, namespace="/robot", joints=("hüfte", "rumpf"))
    with AnyReader([path]) as reader:
        wanted = [c for c in reader.connections if c.topic == f"/robot{TRUTH}"]
        read = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(wanted)]
    assert [m.effort[1] for m in read] == [0.0, 0.0, 1.0, 2.0, 3.0]
    assert read[0].name == ["hüfte", "rumpf"]


def test_channels_have_what_rosbag2_needs_to_play_them(tmp_path):
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.write(writer.channel("/robot/a", topics.JOINT_STATE_TYPE), 5, 5, b"\0\1\0\0")
        writer.write(
            writer.channel("/robot/run/events", topics.DIAGNOSTIC_ARRAY_TYPE), 9, 9, b"\0\1\0\0"
        )
    with AnyReader([path]) as bag:
        ((states,), (events,)) = (c.ext.offered_qos_profiles for c in bag.connections)
    assert (states.depth, states.durability.name) == (5000, "VOLATILE")
    assert (events.depth, events.durability.name) == (1000, "TRANSIENT_LOCAL")
    with path.open("rb") as file:
        reader = make_reader(file)
        records = {m.name: m.metadata for m in reader.iter_metadata()}
        channels = reader.get_summary().channels.values()
    hashes = [channel.metadata["topic_type_hash"][:14] for channel in channels]
    assert hashes == ["RIHS01_a13ee3a", "RIHS01_5a8a36e"]
    about = yaml.safe_load(records["rosbag2"]["serialized_metadata"])
    assert (about["version"], about["message_count"]) == (9, 2)
    assert about["starting_time"] == {"nanoseconds_since_epoch": 5}
    assert about["duration"] == {"nanoseconds": 4}
    told = [topic["topic_metadata"]["name"] for topic in about["topics_with_message_count"]]
    assert told == ["/robot/a", "/robot/run/events"]


def test_a_topic_that_is_gone_is_one_that_differs():
    assert differing({"/a": "1", "/b": "2", "/c": "3"}, {"/b": "2", "/c": "4"}) == ["/a", "/c"]


def test_an_existing_file_is_not_replaced_unless_asked(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError, match=r"a\.mcap exists"):
        RecordingWriter(path)
    assert path.read_bytes() == b"precious"
    RecordingWriter(path, overwrite=True).finish(complete=True, reason="")
    assert Recording.open(path).complete


def test_an_exception_leaves_an_incomplete_file_with_the_reason(tmp_path):
    path = tmp_path / "a.mcap"
    with pytest.raises(KeyError), RecordingWriter(path):
        raise KeyError("gone")
    recording = Recording.open(path)
    assert recording.end == {"complete": "false", "reason": "KeyError: 'gone'"}
    assert not recording.complete


def test_finish_comes_last_and_once(tmp_path):
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.finish(complete=False, reason="stopped")
        size = path.stat().st_size
    assert path.stat().st_size == size
    assert Recording.open(path).end == {"complete": "false", "reason": "stopped"}


def rename(path):
    path.rename(path.with_name("b.mcap"))


def replace(path):
    other = path.with_name("other.mcap")
    RecordingWriter(other).finish(complete=True, reason="finished")
    other.replace(path)


def move_folder(path):
    path.parent.rename(path.parent.with_name("elsewhere"))


@pytest.mark.parametrize(
    ("harm", "says"),
    [
        (rename, "it has been renamed or deleted"),
        (move_folder, "it has been renamed or deleted"),
        (Path.unlink, "it has been (renamed or )?deleted"),
        (replace, "another file has been put in its place"),
        (lambda path: os.truncate(path, 20), "it has been truncated"),
        (lambda path: path.open("ab").write(b"more"), "it has been written to by another process"),
    ],
    ids=["renamed", "folder renamed", "deleted", "replaced", "truncated", "appended"],
)
def test_a_file_that_is_no_longer_what_was_written_ends_the_recording(tmp_path, harm, says):
    path = tmp_path / "folder" / "a.mcap"
    path.parent.mkdir()
    writer = RecordingWriter(path)
    channel = writer.channel("/a", topics.JOINT_STATE_TYPE)
    writer.write(channel, 0, 0, bytes(64))
    writer.flush()
    writer.write(channel, 1, 1, bytes(64))
    writer.check()
    harm(path)
    for attempt in (
        writer.check,
        writer.flush,
        lambda: writer.write(channel, 2, 2, bytes(64)),
        lambda: writer.finish(complete=True, reason="finished"),
    ):
        with pytest.raises(OSError, match=says):
            attempt()


def test_where_a_deleted_file_keeps_its_link_no_more_is_said_than_is_known(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path)
    before = os.fstat(writer._file.fileno())
    path.unlink()
    monkeypatch.setattr(os, "fstat", lambda descriptor: before)  # as on NFS
    with pytest.raises(OSError, match="it has been renamed or deleted"):
        writer.check()


def test_a_file_that_is_being_written_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.channel("/a", topics.JOINT_STATE_TYPE)
        writer.flush()
        size = path.stat().st_size
        with pytest.raises(BlockingIOError, match=r"a\.mcap is being written by another process"):
            RecordingWriter(path, overwrite=True)
        assert path.stat().st_size == size
    assert Recording.open(path).complete
    RecordingWriter(path, overwrite=True).finish(complete=True, reason="")  # it is free again


def test_a_full_disk_is_reported_at_once_and_ends_the_file():
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    writer = RecordingWriter("/dev/full", overwrite=True)
    channel = writer.channel("/a", topics.JOINT_STATE_TYPE)
    writer.write(channel, 0, 0, bytes(64))
    for attempt in (
        writer.flush,
        lambda: writer.write(channel, 1, 1, bytes(64)),
        lambda: writer.finish(complete=True, reason="finished"),
    ):
        with pytest.raises(OSError, match="No space"):
            attempt()
    writer.finish(complete=True, reason="closed already")


@pytest.mark.parametrize("step", ["write", "flush", "add_metadata"])
def test_a_file_with_a_gap_is_never_complete(tmp_path, step):
    resource = pytest.importorskip("resource")
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, "none")
    channel = writer.channel("/a", topics.JOINT_STATE_TYPE)
    writer.write(channel, 0, 0, bytes(64))
    if step != "add_metadata":
        writer.flush()
    steps = {
        "write": lambda: writer.write(channel, 1, 1, bytes(2 << 20)),
        "flush": lambda: (writer.write(channel, 1, 1, bytes(100_000)), writer.flush()),
        "add_metadata": lambda: writer.add_metadata("large", {"a": "b" * 100_000}),
    }
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, old[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            steps[step]()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)  # there is room again
    with pytest.raises(OSError, match="File too large"):
        writer.finish(complete=True, reason="finished")
    recording = Recording.open(path)
    assert recording.topics["/a"].count == 1
    assert recording.end is None
    assert not recording.complete


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_killed_writer_loses_nothing_before_its_flush(tmp_path, compression):
    path = tmp_path / "killed.mcap"
    script = f"""
import os, signal
from trunk_core import topics
from trunk_recording.cdr import layout_of
from trunk_recording.writer import RecordingWriter
from trunk_core.samples import JointSample
writer = RecordingWriter({str(path)!r}, {compression!r})
channel = writer.channel({TRUTH!r}, topics.JOINT_STATE_TYPE)
for k in range(1000):
    sample = JointSample(k, ("hip", "trunk"), (k, k))
    writer.write(channel, k, k, layout_of(sample).pack(sample))
    if k == 699:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    killed = subprocess.run([sys.executable, "-c", script], env=environment, check=False)
    assert killed.returncode == -signal.SIGKILL
    recording = Recording.open(path)
    assert recording.joints(TRUTH).stamp_ns.tolist() == list(range(700))
    assert not recording.complete
    assert len(recording.warnings) == 2


def test_a_file_has_the_index_of_its_chunks(run_file):
    path = run_file.write(20, flush_every=5)
    with path.open("rb") as file:
        chunks = [
            record
            for record in StreamReader(file, emit_chunks=True).records
            if isinstance(record, Chunk)
        ]
        file.seek(0)
        indexed = make_reader(file).get_summary().chunk_indexes
    assert len(chunks) == 5
    assert [(c.message_start_time, c.uncompressed_size) for c in chunks] == [
        (i.message_start_time, i.uncompressed_size) for i in indexed
    ]
