"""Log times that cannot be, and messages in any order: each costs no more than itself."""

import random
from itertools import permutations

import pytest

from trunk_core.samples import JointSample
from trunk_recording.cdr import layout_of
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.repair import recover

from .mcap_files import COMPRESSIONS, write_mcap

MS = 1_000_000
COUNT = 90
BAD = "its log time is beyond the year 2262"


def written(path, times, **options):
    """Write message k with stamp k ms, logged at the times' k-th."""
    samples = (JointSample(k * MS, ("hip", "trunk"), (0.0, float(k))) for k in range(COUNT))
    pairs = zip(times, samples, strict=True)
    messages = [("/a", log, layout_of(s).pack(s)) for log, s in pairs]
    return write_mcap(path, messages, chunk_size=1024, **options)


def logged(bad):
    return [bad.get(k, k * MS) for k in range(COUNT)]


@pytest.mark.parametrize(
    "options", [*({"compression": c} for c in COMPRESSIONS), {"use_chunking": False}]
)
@pytest.mark.parametrize("log_time", [2**63, 2**63 + 1, 2**64 - 1])
@pytest.mark.parametrize("rows", [[0], [41], [COUNT - 1], [0, 1, 2, 50], range(0, COUNT, 2)])
def test_a_topic_with_a_log_time_that_cannot_be_is_not_read(tmp_path, options, log_time, rows):
    path = written(tmp_path / "a.mcap", logged(dict.fromkeys(rows, log_time)), **options)
    run = Recording.open(path)
    refusal = f"/a is not read: message {min(rows)}: {BAD}"
    assert run.warnings[1:] == [refusal]
    assert (run.topics["/a"].count, run.topics["/a"].readable, run.damage) == (COUNT, 0, [])
    with pytest.raises(RecordingError, match=refusal):
        run.joints("/a")


def seen(run):
    topic = run.topics["/a"]
    return topic.first_stamp_ns, topic.last_stamp_ns, run.longest_gap_ns("/a"), topic.count


def shuffled(seed):
    rows = list(range(COUNT))
    random.Random(seed).shuffle(rows)
    return rows


ORDERS = {
    "reversed": list(range(COUNT))[::-1],
    "the last first": [COUNT - 1, *range(COUNT - 1)],
    "two halves": [*range(40, COUNT), *range(40)],
    **{f"shuffled {seed}": shuffled(seed) for seed in range(5)},
}


@pytest.mark.parametrize("rows", ORDERS.values(), ids=ORDERS)
def test_spans_and_gaps_do_not_depend_on_the_order(tmp_path, rows):
    samples = [JointSample(k * MS + (k > 60) * 9 * MS, ("hip",), (float(k),)) for k in rows]
    messages = [("/a", s.stamp_ns + 3, layout_of(s).pack(s)) for s in samples]
    path = write_mcap(tmp_path / "a.mcap", messages, chunk_size=1024)
    assert seen(Recording.open(path)) == (0, (COUNT - 1 + 9) * MS, 10 * MS, COUNT)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_the_files_of_a_bag_may_be_listed_in_any_order(tmp_path, order):
    for part in range(3):
        samples = [JointSample(k * MS, ("hip",), (0.0,)) for k in range(30 * part, 30 * part + 30)]
        messages = [("/a", s.stamp_ns, layout_of(s).pack(s)) for s in samples]
        write_mcap(tmp_path / f"bag_{part}.mcap", messages)
    listed = "".join(f"    - bag_{part}.mcap\n" for part in order)
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  message_count: 90\n"
        f"  relative_file_paths:\n{listed}"
    )
    assert seen(Recording.open(tmp_path)) == (0, 89 * MS, MS, COUNT)


@pytest.mark.parametrize("encoding", ["json", "ros1", "protobuf", "cbor"])
def test_an_encoding_that_is_not_read_is_named(tmp_path, encoding):
    path = write_mcap(
        tmp_path / "a.mcap", [("/a", k * MS, b"{}") for k in range(11)], encoding=encoding
    )
    run = Recording.open(path)
    assert run.warnings[1] == f"/a is not read: encoded as {encoding}, only cdr is read"
    assert seen(run) == (0, 10 * MS, MS, 11)
    with pytest.raises(RecordingError, match=f"encoded as {encoding}, only cdr is read"):
        run.joints("/a")


@pytest.mark.parametrize("rows", [[41], range(COUNT)])
def test_recover_logs_messages_at_their_stamps_where_their_log_times_cannot_be(tmp_path, rows):
    path = written(tmp_path / "a.mcap", logged(dict.fromkeys(rows, 2**63)))
    recovery = recover(path, tmp_path / "b.mcap")
    assert (recovery.count, recovery.lost) == (COUNT, [])
    table = Recording.open(tmp_path / "b.mcap").joints("/a")
    assert table.log_time_ns.tolist() == table.stamp_ns.tolist() == [k * MS for k in range(COUNT)]


def test_recover_leaves_out_what_cannot_be_read(tmp_path):
    samples = [JointSample(k * MS, ("hip",), (float(k),)) for k in range(5)]
    messages = [("/a", s.stamp_ns, layout_of(s).pack(s)) for s in samples]
    messages[3] = ("/a", 3 * MS, b"\0\1\0\0")
    recovery = recover(write_mcap(tmp_path / "a.mcap", messages), tmp_path / "b.mcap")
    (lost,) = recovery.lost
    assert lost.startswith("a message on /a in the record at byte ")
    assert Recording.open(tmp_path / "b.mcap").joints("/a").position[:, 0].tolist() == [0, 1, 2, 4]
