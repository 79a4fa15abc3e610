"""What is verified is what other libraries read."""

import shutil
import struct
from dataclasses import replace

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType
from ros2_ws.src.trunk_recording.test.mcap_files import (
    ANEW,
    MAGIC,
    chunk,
    content,
    data_of,
    finish,
    message,
    moved,
    raw,
    record,
    records_of,
    reindexed,
    schema,
    summary_of,
    summary_records,
    write,
    write_file,
    write_records,
)
from rosbags.highlevel import AnyReader

from trunk_recording.digests import ATTACHMENTS, DIGESTS, PROVENANCE
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

DATA = (Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.METADATA)


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    record_offline(make_plan("fig8", "pid", everywhere={"duration": 0.05}), path)
    return path


@pytest.fixture
def run(original, tmp_path, monkeypatch):
    """Return a copy of a short run, in the working directory."""
    monkeypatch.chdir(tmp_path)
    return shutil.copy(original, tmp_path / "run.mcap")


@pytest.fixture(scope="module")
def chunked(original, tmp_path_factory):
    """The run in a dozen chunks, as mcap writes them."""
    path = tmp_path_factory.mktemp("chunked") / "run.mcap"
    write_file(content(original), path, chunk_size=3000)
    return path


def ours(path):
    recording = Recording.open(path)
    return sorted(
        (topic, log, data)
        for topic in recording.topics
        for block in recording.messages(topic)
        for log, data in zip(*block, strict=True)
    )


def by_mcap(path):
    with path.open("rb") as file:
        return sorted(
            (c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()
        )


def by_rosbags(path):
    with AnyReader([path]) as reader:
        return sorted((c.topic, log, bytes(data)) for c, log, data in reader.messages())


def judged(trunk, path):
    """Return the exit codes of verify and info --check, and what they said."""
    code, said, err = trunk("verify", path)
    examined, findings, _ = trunk("info", "--check", path)
    return (code, examined), said + err, findings


def changed(records, place, **fields):
    records[place] = replace(records[place], **fields)


def indexed(summary):
    """Return where the indexes of a chunk with several topics are."""
    places = (chunk.message_index_offsets for chunk in summary.chunks)
    return next(there for there in places if len(there) > 1)


def other_index(summary):
    places = indexed(summary)
    first, second, *_ = places
    places[first], places[second] = places[second], places[first]


def miscounted(summary):
    counts = summary.statistics.channel_message_counts
    first, second = list(counts)[:2]
    counts[first], counts[second] = counts[first] + 1, counts[second] - 1


SUMMARIES = {
    "a chunk left out": (lambda s: s.chunks.pop(2), "chunks"),
    # The statistics go with the index, as where another tool has filtered the file.
    "a chunk left out, not counted": (
        (lambda s: (s.chunks.pop(2), setattr(s, "statistics", None))),
        "chunks",
    ),
    "a chunk twice": (lambda s: s.chunks.append(s.chunks[2]), "chunks"),
    "a topic renamed": (
        (lambda s: changed(s.channels, 0, topic="/renamed")),
        "was described differently before",
    ),
    "a channel renumbered": (lambda s: changed(s.channels, 0, id=99), "channels"),
    "no channel": (lambda s: s.channels.pop(0), "channels"),
    "no schema": (lambda s: s.schemas.pop(0), "schemas"),
    "no metadata": (lambda s: s.metadata.pop(0), "metadata records"),
    "another time": (lambda s: changed(s.chunks, 1, message_end_time=1), "chunks"),
    "another index": (other_index, "chunks"),
    "a topic left out": (lambda s: indexed(s).popitem(), "chunks"),
    "no message indexes": (lambda s: indexed(s).clear(), "chunks"),
    "other counts": (miscounted, "or they are on other channels"),
}


@pytest.mark.parametrize("name", SUMMARIES)
def test_a_summary_that_disagrees_with_the_data_is_not_verified(chunked, run, trunk, name):
    edit, says = SUMMARIES[name]
    says = says if " " in says.removeprefix("metadata ") else f"the summary's {says} are not those"
    reindexed(chunked, run, edit)
    codes, said, findings = judged(trunk, "run.mcap")
    assert codes[1] == 1, findings
    assert codes[0] == (1 if name == "a channel renumbered" else 2), (
        said
    )  # its digest shows it, too
    assert says in said
    assert says in findings


def test_messages_outside_of_chunks_are_seen_by_no_index(chunked, run, trunk):
    reindexed(chunked, run, lambda _: None, raw(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 9, 9)))
    codes, said, findings = judged(trunk, "run.mcap")
    assert codes == (1, 1)  # its digests show it, too
    assert "1 messages outside of chunks are in no index" in findings
    assert "1 messages outside of chunks are in no index" in said


def test_a_message_index_left_out_is_found(chunked, run, trunk):
    data = bytearray(chunked.read_bytes())
    at, end = next((at, end) for k, at, end in records_of(data) if k == Opcode.MESSAGE_INDEX)
    data[at] = UNKNOWN[-1]
    run.write_bytes(data)

    def without(summary):
        (index,) = (c for c in summary.chunks if at in c.message_index_offsets.values())
        index.message_index_length -= end - at
        index.message_index_offsets = {
            number: place for number, place in index.message_index_offsets.items() if place != at
        }

    reindexed(run, run, without)
    codes, said, findings = judged(trunk, "run.mcap")
    assert codes == (2, 1)
    assert all("the chunk lacks message indexes" in text for text in (said, findings))


def second(path, at, tmp_path):
    """Return another run's bytes; with ``at``, its places count from the file's first byte."""
    other = tmp_path / "other.mcap"
    record_offline(make_plan("fig8", "pid", everywhere={"duration": 0.02}), other)
    whole = other.read_bytes()
    if not at:
        return whole
    summary = summary_of(other)
    summary.chunks = [moved(chunk, at) for chunk in summary.chunks]
    summary.metadata = [replace(index, offset=index.offset + at) for index in summary.metadata]
    return finish(data_of(whole), summary_records(summary), at)


TAILS = {
    "a byte": lambda whole, _: b"\0",
    "zeros": lambda whole, _: bytes(100),
    "the magic": lambda whole, _: MAGIC,
    "itself": lambda whole, _: whole,
    "another run": lambda whole, folder: second(whole, 0, folder),
    "another run with absolute places": lambda whole, folder: second(whole, len(whole), folder),
}


@pytest.mark.parametrize("tail", TAILS.values(), ids=TAILS)
def test_bytes_after_the_end_are_no_part_of_a_verified_run(original, run, trunk, tmp_path, tail):
    whole = original.read_bytes()
    after = tail(whole, tmp_path)
    run.write_bytes(whole + after)
    said = f"{len(after)} bytes after the end at byte {len(whole)}: other readers may see another"
    codes, verdict, findings = judged(trunk, "run.mcap")
    assert codes == (2, 1)
    assert said in verdict
    assert said in findings
    for verb in ("info", "metrics"):
        code, out, err = trunk(verb, "run.mcap")
        assert (code, said in err) == (0, True), out + err
    code, out, _ = trunk("recover", "run.mcap", "-o", "mended.mcap")
    assert (code, said in out) == (1, True)
    assert ours(tmp_path / "mended.mcap") == ours(original) == by_mcap(tmp_path / "mended.mcap")
    assert not Recording.open(tmp_path / "mended.mcap").damage


def test_another_run_after_the_first_is_what_others_read(original, run, tmp_path):
    whole = original.read_bytes()
    run.write_bytes(whole + second(whole, len(whole), tmp_path))
    assert len(by_mcap(run)) < len(ours(run)) == len(ours(original))


UNKNOWN = (0x10, 0x42, 0x7F, 0x80, 0xC3, 0xFF)


def inserted(whole, record, before):
    """Return a file's data with a record before one of its records, and no summary."""
    data = data_of(whole)
    kinds = [(at, opcode) for opcode, at, _ in records_of(whole) if at < len(data)]
    place = next(at for at, opcode in kinds if opcode == before) if before else len(data)
    return finish(data[:place] + record + data[place:])


@pytest.mark.parametrize("before", [*DATA, None])
@pytest.mark.parametrize("kind", UNKNOWN)
def test_records_of_unknown_kinds_are_skipped_and_named(original, run, trunk, kind, before):
    run.write_bytes(inserted(original.read_bytes(), raw(kind, b"private"), before))
    assert ours(run) == ours(original) == by_mcap(run)
    codes, said, findings = judged(trunk, "run.mcap")
    assert codes == (2, 0)
    assert f"no digests of records of unknown kinds ({kind:#04x}): an edit would not show" in said
    assert f"a record of the unknown kind {kind:#04x} is skipped" in findings
    code, out, _ = trunk("recover", "run.mcap", "-o", "mended.mcap")
    assert (code, f"lost: records of unknown kinds ({kind:#04x})" in out) == (1, True)


def test_a_record_of_kind_zero_is_damage(original, run, trunk):
    run.write_bytes(inserted(original.read_bytes(), raw(0, b"nothing"), Opcode.CHUNK))
    codes, said, findings = judged(trunk, "run.mcap")
    assert codes == (2, 1)
    assert all("a record of kind 0x00, which is not valid" in text for text in (said, findings))


def test_what_is_verified_is_what_others_read(chunked, run, trunk):
    reindexed(chunked, run, lambda _: None)
    assert judged(trunk, "run.mcap")[0] == (0, 0)
    assert ours(run) == by_mcap(run) == by_rosbags(run)


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.NONE, "chunk_size": 1000},
        {"compression": CompressionType.LZ4, "chunk_size": 1 << 20, "use_statistics": False},
        {"use_chunking": False},
    ],
    ids=["small chunks", "one chunk of LZ4", "no chunks"],
)
def test_the_same_content_written_anew_is_verified(original, run, trunk, options):
    write_file(content(original), run, **options)
    assert run.read_bytes() != original.read_bytes()
    assert judged(trunk, "run.mcap")[0] == (0, 0)


def test_a_redescribed_channel_is_not_verified(original, run, trunk):
    """Other readers would take true states for measured ones."""
    found = content(original)
    write_file(found, run, use_chunking=False)
    whole = run.read_bytes()
    measured, true = (found.channels[t] for t in ("/joint_states", "/ground_truth/joint_states"))
    swapped = replace(measured, topic=true.topic), replace(true, topic=measured.topic)
    first = next(at for kind, at, _ in records_of(whole) if kind == Opcode.MESSAGE)
    run.write_bytes(finish(whole[:first] + record(*swapped) + data_of(whole)[first:]))
    codes, said, _ = judged(trunk, "run.mcap")
    assert (codes[0], "described differently" in said) == (2, True), said


def test_what_no_digest_covers_is_not_verified(original, run, trunk):
    found = content(original)
    found.attachments.append(("notes.txt", b"first"))
    assert write(found, run, ANEW).digests[ATTACHMENTS] == "1"
    codes, said, _ = judged(trunk, "run.mcap")
    assert (codes[0], "no digests of the attachments' content" in said) == (2, True)


def test_a_topic_named_like_a_part_is_not_covered(original, run):
    found = content(original)
    found.channels["/joint_states"].topic = "heads"
    assert "a topic with the name heads" in write(found, run, ANEW).undigested()


def test_a_change_to_a_digest_alone_diverges(original, run, trunk):
    found = content(original)
    found.values(DIGESTS)["heads"] = "00" * 32
    write_file(found, run)
    assert judged(trunk, "run.mcap")[0][0] == 1


def padded(data, kinds, padding):
    """Return records as bytes, those of some kinds longer than is known."""
    whole, made = MAGIC + data + MAGIC, b""
    for opcode, at, end in records_of(whole):
        body = whole[at + 9 : end] + (padding if opcode in kinds else b"")
        made += raw(opcode, body)
    return made


@pytest.mark.parametrize("padding", [b"\0", b"\1\xff\xff", bytes(range(64))], ids=len)
@pytest.mark.parametrize(
    "kind", [Opcode.HEADER, *DATA, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.METADATA_INDEX]
)
def test_records_longer_than_is_known_are_read(original, run, trunk, kind, padding):
    data = data_of(original.read_bytes())
    if kind in (Opcode.HEADER, *DATA):
        run.write_bytes(finish(MAGIC + padded(data[len(MAGIC) :], [kind], padding)))
    else:  # the places in the index stay right
        summary = summary_records(summary_of(original))
        run.write_bytes(finish(data, padded(summary, [kind], padding)))
    assert ours(run) == ours(original) == by_mcap(run)
    assert judged(trunk, "run.mcap")[0] == (0, 0)
    code, out, _ = trunk("recover", "run.mcap", "-o", "mended.mcap")
    assert (code, ours(run.parent / "mended.mcap")) == (0, ours(original)), out


def later(summary):
    last = summary.statistics.message_end_time + 31 * 365 * 86_400 * 10**9
    summary.statistics = replace(summary.statistics, message_end_time=last)


def of_all_chunks(**fields):
    def edit(summary):
        summary.chunks = [replace(chunk, **fields) for chunk in summary.chunks]

    return edit


def twice(path):
    """Give a key of the origin twice: who reads the map keeps one value or the other."""
    data = data_of(path.read_bytes())
    at, end = next(
        (at, end) for k, at, end in records_of(path.read_bytes()) if k == Opcode.METADATA
    )
    name, pairs = (
        data[at + 9 :][: 4 + len(PROVENANCE)],
        data[at + 9 + 4 + len(PROVENANCE) + 4 : end],
    )
    key, value = (struct.pack("<I", len(text)) + text for text in (b"mode", b"real_time"))
    body = name + struct.pack("<I", len(key + value + pairs)) + key + value + pairs
    return finish(data[:at] + raw(Opcode.METADATA, body) + data[end:])


def with_an_empty_key(path):
    recorded = content(path)
    recorded.values(DIGESTS)[""] = ""
    write_file(recorded, path)
    return path.read_bytes()


def summed_up(edit):
    def edited(path):
        return reindexed(path, path, edit).read_bytes()

    return edited


READ_OTHERWISE = {
    "the statistics' times": summed_up(later),
    "no index of metadata": summed_up(lambda summary: summary.metadata.clear()),
    "no channels": summed_up(lambda summary: summary.channels.clear()),
    "another compression": summed_up(of_all_chunks(compression="lz4")),
    "another size": summed_up(of_all_chunks(uncompressed_size=1)),
    "another compressed size": summed_up(of_all_chunks(compressed_size=1)),
    "a key twice": twice,
    "an empty key among the digests": with_an_empty_key,
}


@pytest.mark.parametrize("edit", READ_OTHERWISE.values(), ids=READ_OTHERWISE)
def test_what_others_would_read_otherwise_is_not_verified(chunked, run, trunk, edit):
    run.write_bytes(chunked.read_bytes())
    run.write_bytes(edit(run))
    assert judged(trunk, "run.mcap")[0][0] != 0


def test_a_key_twice_in_a_chunks_channel_is_found(tmp_path):
    """Channels may be described inside of chunks alone: they are looked at there, too."""

    def described(keys):
        pairs = b"".join(
            struct.pack("<I", len(text)) + text for key in keys for text in (key, b"value")
        )
        texts = b"".join(struct.pack("<I", len(text)) + text for text in (b"/joints", b"cdr"))
        body = struct.pack("<HH", 1, 1) + texts + struct.pack("<I", len(pairs)) + pairs
        return schema(1, "sensor_msgs/msg/JointState") + raw(Opcode.CHANNEL, body)

    for keys, count in (((b"a", b"b"), 0), ((b"a", b"a"), 1)):
        records = described(keys) + message(1, 0, b"")
        path = write_records(tmp_path / "run.mcap", chunk(records))
        (file,) = Recording.open(path).opened
        assert sum("key twice" in finding.message for finding in file.findings) == count
