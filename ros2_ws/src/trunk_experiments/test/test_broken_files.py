"""Any broken file gives a valid prefix and a warning, or one clear line and exit code 2."""

import json
import os
import random
from contextlib import suppress

import pytest
from mcap.writer import Writer

from trunk_recording.reader import Recording, RecordingError
from trunk_recording.writer import PROVENANCE, RecordingWriter

from ...trunk_recording.test.mcap_files import ANEW, copied, records_of

TRUTH = "/ground_truth/joint_states"


@pytest.fixture(scope="module")
def whole(short_run, tmp_path_factory):
    """A run in many small chunks: its bytes, its true states, its topics."""
    run = Recording.open(short_run("fig8", "pid", duration=0.3))
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    messages = [
        (log, topic, data)
        for topic in run.topics
        for block in run.messages(topic)
        for log, data in zip(*block, strict=True)
    ]
    with RecordingWriter(path) as writer:
        writer.add_metadata(PROVENANCE, run.provenance)
        channels = {name: writer.channel(name, topic.type) for name, topic in run.topics.items()}
        for i, (log, topic, data) in enumerate(sorted(messages)):
            writer.write(channels[topic], log, log, data)
            if i % 100 == 0:
                writer.flush()
    recording = Recording.open(path)
    return path.read_bytes(), recording.joints(TRUTH), recording.topics


def refused(code, out, err, path):
    """Assert that a file was refused in one clear line, and with --json in a document, too."""
    *_, last = err.splitlines()
    assert code == 2
    assert not out or json.loads(out)["error"] in last
    assert err.count("trunk: error: ") == 1
    assert last.startswith("trunk: error: ")
    assert str(path) in last
    assert "Traceback" not in err


def judge(trunk, path, whole):
    """Judge what metrics says of a broken copy; return whether it passed for complete, and stderr."""
    code, out, err = trunk("metrics", "--json", path)
    lines = err.splitlines()
    if code:
        refused(code, out, err, path)
        return False, err
    assert json.loads(out)["metrics"]["theta_max_deg"] <= 180.0
    joints = Recording.open(path).joints(TRUTH)
    _, expected, _ = whole
    n = len(joints)
    assert joints.stamp_ns.tolist() == expected.stamp_ns[:n].tolist()
    assert joints.position.tobytes() == expected.position[:n].tobytes()
    code, out, said = trunk("info", "--json", path)
    if code:  # it reads more topics than metrics does
        refused(code, out, said, path)
        assert lines
        return False, err
    complete = json.loads(out)["doubts"]["complete"]
    if not lines:  # no warning, so nothing is missing
        assert complete
        assert n == len(expected)
    return complete, err


# A thousand of each with TRUNK_BROKEN=1000; what is tried here has one in every record.
MORE = int(os.environ.get("TRUNK_BROKEN", "0"))


def spread(data, count):
    """Return this many offsets, evenly spread over a file."""
    return [i * len(data) // count for i in range(count)]


def records(data):
    """Return where each record of a file begins, and its length with its header."""
    return [(begin, end - begin) for _, begin, end in records_of(data)]


def sample(items, count):
    """Return the first, the last, and evenly spread ones of the rest."""
    return sorted({items[i * (len(items) - 1) // (count - 1)] for i in range(count)})


@pytest.mark.slow
def test_cuts(whole, trunk, tmp_path):
    data, _, _ = whole
    path = tmp_path / "cut.mcap"
    end_record = data.rindex(b"trunk_end", 0, data.rindex(b"trunk_end") - 1)
    lengths = set()
    # Between two records, in a record's header, and in its middle.
    cuts = {0, 4} | {
        at + more for at, length in sample(records(data), 13) for more in (0, 5, length // 2)
    }
    for size in spread(data, MORE) if MORE else sorted(cuts):
        path.write_bytes(data[:size])
        complete, err = judge(trunk, path, whole)
        assert not (complete and size < end_record)
        assert err
        lengths.add(len(Recording.open(path).joints(TRUTH)) if size > 8 else 0)
    assert len(lengths) > 5


@pytest.mark.slow
def test_flipped_bits(whole, trunk, tmp_path):
    data, _, _ = whole
    path = tmp_path / "flipped.mcap"
    data_end = data.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")
    chosen = random.Random(7)
    # A record's opcode, its length's lowest and highest byte, its first byte, and one somewhere in it.
    flips = {0, 5, len(data) - 1} | {
        at + more
        for at, length in sample(records(data), 8)
        for more in (0, 1, 8, 9, chosen.randrange(9, length))
    }
    if MORE:
        flips = {at + chosen.randrange(len(data) // MORE) for at in spread(data, MORE)}
    for at in sorted(flips):
        altered = bytearray(data)
        altered[at] ^= 1 << chosen.randrange(8)
        path.write_bytes(altered)
        complete, _ = judge(trunk, path, whole)
        assert not complete or at >= data_end  # only indexes follow
        if 8 <= at < len(data) - 8:  # its recorder closed it, by its last bytes
            with suppress(RecordingError):
                flipped = Recording.open(path)
                why = [flipped.unfinished, *flipped.warnings, *flipped.seen_otherwise]
                assert not [line for line in why if "shut down" in line or "None" in line]


def test_files_that_are_not_recordings(trunk, tmp_path):
    empty, text = tmp_path / "empty.mcap", tmp_path / "text.mcap"
    empty.write_bytes(b"")
    text.write_text("t,x\n0,0\n")
    (tmp_path / "folder").mkdir()
    for verb in ("metrics", "info", "info --check", "export", "verify"):
        for path in (empty, text, tmp_path / "folder", tmp_path / "missing"):
            more = ("-o", tmp_path / "x.csv") if verb == "export" else ()
            code, out, err = trunk(*verb.split(), path, *more)
            assert (code, out, len(err.splitlines())) == (2, "", 1)
            assert str(path) in err


def foreign(path, count=30, topics=("/other",), twice=False):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "foreign")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        for _ in range(1 + twice):
            for topic in topics:
                channel = writer.register_channel(topic, "cdr", schema)
                for k in range(count):
                    writer.add_message(channel, k, b"\0\1\0\0\2\0\0\0a\0", k)
        writer.finish()
    return path


def test_a_bag_without_our_topics(trunk, tmp_path):
    path = foreign(tmp_path / "a.mcap", twice=True)
    code, out, _ = trunk("info", "--json", path)
    assert (code, json.loads(out)["topics"]["/other"]["messages"]) == (0, 60)
    code, out, err = trunk("metrics", path)
    assert (code, out) == (2, "")
    assert "no messages on /ground_truth/joint_states" in err


def test_our_topic_with_another_type_gives_one_line(trunk, tmp_path):
    path = foreign(tmp_path / "a.mcap", topics=(TRUTH, "/run/parameters"))
    code, out, err = trunk("metrics", path)
    assert (code, out) == (2, "")
    assert "cannot be read" in err.splitlines()[-1]
    code, out, err = trunk("info", path)
    assert code == 0
    assert "/run/parameters is not read: message 0: its type is std_msgs/msg/String" in err


def test_doubled_topics_and_messages_count_once(whole, trunk, tmp_path, short_run):
    """Each topic on two channels, each message twice: the first of a stamp counts."""
    path = tmp_path / "twice.mcap"
    recording = Recording.open(short_run("fig8", "pid", duration=0.3))
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "foreign")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        for topic in (TRUTH, "/joint_states", "/effort_command", "/pid/state"):
            channels = [writer.register_channel(topic, "cdr", schema) for _ in range(2)]
            for log, messages in recording.messages(topic):
                for at, message in zip(log, messages, strict=True):
                    for channel in channels:
                        writer.add_message(channel, at, message, at)
        writer.finish()
    single = json.loads(trunk("metrics", "--json", recording.path)[1])
    code, out, _ = trunk("metrics", "--json", path)
    assert code == 0
    twice = json.loads(out)
    assert twice["doubts"]["reason"].startswith("recorded by foreign: ")
    assert twice["doubts"]["complete"] is False
    assert single["doubts"]["complete"] is True
    assert twice["metrics"] == single["metrics"]
    code, out, _ = trunk("info", "--check", path)
    assert code == 1
    assert f"{TRUTH}, t = 0 s: the stamp appears twice" in out


def test_a_deep_yaml(tmp_path):
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("[" * 2000)
    with pytest.raises(RecordingError, match="does not describe a bag"):
        Recording.open(bag)


def test_files_of_another_format_are_named_and_not_read(short_run, tmp_path, trunk):
    path = tmp_path / "old.mcap"
    written = short_run("fig6", "pid")
    copied(written, path, lambda _: None, ANEW, provenance={"format": "1"})
    code, _, err = trunk("info", path)
    assert code == 2
    assert err.startswith(f"trunk: error: {path} is of format '1', this version reads format '2'")
    assert err.count("\n") == 1
