"""The reader against rosbags, to the last bit, over all kinds of files."""

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import IndexType
from ros2_ws.src.trunk_recording.test.mcap_files import write_mcap
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable
from trunk_recording.cdr import JointStateLayout, layout_of
from trunk_recording.reader import Recording, RecordingError

TYPE = topics.JOINT_STATE_TYPE
STORE = get_typestore(Stores.ROS2_JAZZY)
TOPICS = (f"/{topics.GROUND_TRUTH}", f"/{topics.JOINT_STATES}", "/effort_command", "/pid/state")

# Three layouts: a stream may change from one to another, or not.
LAYOUTS = (
    lambda k, v: JointSample(k, ("hip", "trunk"), (v, -v), (v / 3, v), (0.0, v)),
    lambda k, v: JointSample(k, ("trunk", "hip"), (v, 2 * v)),
    lambda k, v: JointSample(k, ("a",), effort=(v,)),
)


@st.composite
def streams(draw):
    """Messages as (topic, log time, CDR) in an order that repeats, or does not."""
    cycle = draw(st.lists(st.sampled_from(TOPICS), min_size=1, max_size=5))
    layouts = {topic: draw(st.sampled_from(LAYOUTS)) for topic in TOPICS}
    values = st.floats(allow_nan=True, width=64)
    found = []
    for k in range(draw(st.integers(0, 120))):
        for topic in cycle:
            layout = draw(st.sampled_from(LAYOUTS)) if k == 77 else layouts[topic]
            tail = draw(st.sampled_from([b"", b"\0" * 4])) if k == 99 else b""
            value = draw(values) if k < 5 else float(k)
            sample = layout(k * 1_000_000, value)
            found.append((topic, k * 1_000_000, layout_of(sample).pack(sample) + tail))
    return found


TERMS = law_named("pid").record_names


def by_rosbags(messages, topic):
    """Return (names, stamps, position, velocity, effort) of each message, one at a time."""
    found = []
    for name, _, data in messages:
        if name == topic:
            size = JointStateLayout.parse(data).size  # rosbags rejects the tail that rmw may leave
            m = STORE.deserialize_cdr(data[:size], TYPE)
            stamp_ns = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
            found.append((tuple(m.name), stamp_ns, m.position, m.velocity, m.effort))
    return found


def assert_same_bits(joints, expected):
    assert joints.stamp_ns.tolist() == [stamp for _, stamp, *_ in expected]
    for i, (names, _, *quantities) in enumerate(expected):
        for quantity, values in zip(("position", "velocity", "effort"), quantities, strict=True):
            read = [joints.column(quantity, name)[i] for name in names]
            if len(values):
                assert np.array(read).tobytes() == values.tobytes()
            else:
                assert np.isnan(read).all()


@pytest.mark.slow
@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    streams(),
    st.sampled_from(["zstd", "lz4", "none"]),
    st.booleans(),
    st.sampled_from([IndexType.ALL, IndexType.NONE]),
    st.booleans(),
)
def test_arrays_are_those_of_rosbags(tmp_path, messages, compression, chunks, index, statistics):
    path = write_mcap(
        tmp_path / "a.mcap",
        messages,
        compression=compression,
        use_chunking=chunks,
        index_types=index,
        use_statistics=statistics,
    )
    recording = Recording.open(path)
    arrays = recording.tables(dict.fromkeys(TOPICS))
    for topic in TOPICS:
        expected = by_rosbags(messages, topic)
        assert_same_bits(arrays[topic], expected)
        blocks = list(recording.messages(topic))
        log, data = (list(itertools.chain(*(block[i] for block in blocks))) for i in (0, 1))
        assert list(zip(log, data, strict=True)) == [m[1:] for m in messages if m[0] == topic]
        assert recording.joint_names(topic) == (expected[0][0] if expected else ())
    wanted = {topic: [("position", "trunk"), ("effort", "a")] for topic in TOPICS}
    for topic, table in recording.tables(wanted).items():
        series = table.by_stamp()
        whole = arrays[topic].by_stamp()
        assert series.stamp_ns.tolist() == whole.stamp_ns.tolist()
        for column in wanted[topic]:
            values = series.column(*column)
            assert values.tobytes() == np.ascontiguousarray(whole.column(*column)).tobytes()


def test_each_chunk_is_decompressed_once_for_all_topics(tmp_path, monkeypatch):
    samples = [
        (t, k, layout_of(LAYOUTS[0](k, 1.0)).pack(LAYOUTS[0](k, 1.0)))
        for k in range(400)
        for t in TOPICS
    ]
    path = write_mcap(tmp_path / "a.mcap", samples)
    monkeypatch.setattr("trunk_recording.reader._KEPT", 0)
    recording = Recording.open(path)
    read = []
    original = type(recording.opened[0]).content
    monkeypatch.setattr(
        type(recording.opened[0]),
        "content",
        lambda self, file, block: read.append(block.offset) or original(self, file, block),
    )
    recording.tables({topic: [("effort", "trunk")] for topic in TOPICS})
    assert len(read) > 10
    assert len(read) == len(set(read))


def run_messages(steps):
    for k in range(steps + 1):
        t = k * 1_000_000
        truth = JointSample(t, ("hip", "trunk"), (k, k + 0.25), (-k, -k - 0.5), (0.0, 1.0 * k))
        state = JointSample(t, TERMS, position=(0.5,) * len(TERMS))
        command = JointSample(t, ("trunk",), effort=(k + 1.0,))
        for topic, sample in zip(TOPICS, (truth, truth, command, state), strict=True):
            yield topic, 10**18 + t + 7, layout_of(sample).pack(sample)


def write_bag(folder, messages, compression=None):
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    if compression:
        writer.set_compression(getattr(CompressionMode, compression), CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, log_time_ns, data in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, TYPE, typestore=STORE)
            writer.write(connections[topic], log_time_ns, data)
    return folder


@pytest.mark.parametrize("compression", [None, "STORAGE"])
def test_a_rosbags_bag_is_a_run(tmp_path, compression):
    bag = write_bag(tmp_path / "bag", run_messages(50), compression)
    recording = Recording.open(bag)
    assert not recording.complete
    (warning,) = recording.warnings
    assert "recorded by rosbags" in warning
    table = RunTable.from_run(RecordedRun(recording))
    assert table.theta.tolist() == [k + 0.25 for k in range(51)]
    assert table.torque.tolist() == [*range(1, 51), 51]
    assert table.reference.tolist() == [0.5] * 51
    alone = RunTable.from_run(RecordedRun.open(bag / "bag.mcap"))
    assert alone.theta.tolist() == table.theta.tolist()


def split_bag(folder, messages, parts=3, metadata=True):
    """Imitate ``ros2 bag record -s mcap -d``: bag_0.mcap, bag_1.mcap ... and one metadata.yaml."""
    folder.mkdir()
    messages = list(messages)
    size = -(-len(messages) // parts)
    files = []
    for i in range(parts):
        part = messages[i * size : (i + 1) * size]
        if i == 1:
            part = part[::-1]  # each file numbers its channels independently
        path = folder / f"bag_{i}.mcap"
        files.append(write_mcap(path, part, library="libmcap 1.3.1", chunk_size=786432).name)
    if metadata:
        (folder / "metadata.yaml").write_text(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n"
            f"  relative_file_paths: [{', '.join(files)}]\n  message_count: {len(messages)}\n"
            '  compression_format: ""\n  compression_mode: ""\n  custom_data: ~\n'
            "  duration: {nanoseconds: 5}\n  ros_distro: jazzy\n"
        )
    return folder


@pytest.mark.parametrize("metadata", [True, False])
def test_a_split_bag_is_one_run(tmp_path, metadata):
    bag = split_bag(tmp_path / "bag", run_messages(200), 11, metadata)
    recording = Recording.open(bag)
    assert [path.name for path in recording.files] == [f"bag_{i}.mcap" for i in range(11)]
    assert recording.topics["/effort_command"].count == 201
    assert recording.size == sum(path.stat().st_size for path in bag.glob("*.mcap"))
    says = "recorded by libmcap" if metadata else "no metadata.yaml"
    assert len(recording.warnings) == 1
    assert says in recording.warnings[0]
    table = RunTable.from_run(RecordedRun(recording))
    assert table.theta.tolist() == [k + 0.25 for k in range(201)]
    assert table.torque.tolist() == [*range(1, 201), 201]


def test_unrelated_recordings_in_a_folder_are_not_one_run(tmp_path):
    bag = split_bag(tmp_path / "bag", run_messages(60), metadata=False)
    (bag / "bag_1.mcap").rename(bag / "other_1.mcap")
    with pytest.raises(RecordingError, match=r"has \d+ recordings and no metadata\.yaml") as caught:
        Recording.open(bag)
    assert "give one of bag_0.mcap, bag_2.mcap, " in str(caught.value)


def test_a_damaged_part_ends_the_run(tmp_path):
    bag = split_bag(tmp_path / "bag", run_messages(60))
    path = bag / "bag_1.mcap"
    path.write_bytes(path.read_bytes()[:100])
    recording = Recording.open(bag)
    assert recording.warnings[0].startswith("bag_1.mcap: ends at byte 100")
    assert recording.warnings[1] == "1 later file is not read"
    assert "metadata.yaml counts 244 messages" in recording.warnings[2]
    assert len(recording.joints("/effort_command")) < 25


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda bag: (bag / "bag_2.mcap").unlink(), "bag_2.mcap, which is missing"),
        (lambda bag: (bag / "metadata.yaml").write_text("{"), "does not describe a bag"),
        (lambda bag: (bag / "metadata.yaml").write_text("a: b"), "does not describe a bag"),
        (lambda bag: replace(bag, "relative_file", "other"), "lists no files"),
        # Files elsewhere are not read, whatever the metadata say.
        (
            lambda bag: replace(bag, "bag_1.mcap", "/etc/passwd"),
            "lists /etc/passwd, which is missing",
        ),
        (lambda bag: replace(bag, "bag_1.mcap", ".."), "lists .., which is missing"),
    ],
)
def test_what_is_not_a_bag_gives_one_line(tmp_path, change, says):
    bag = split_bag(tmp_path / "bag", run_messages(9))
    change(bag)
    with pytest.raises(RecordingError, match=says) as caught:
        Recording.open(bag)
    assert "\n" not in str(caught.value)
    assert str(bag) in str(caught.value)


def replace(bag, old, new):
    path = bag / "metadata.yaml"
    path.write_text(path.read_text().replace(old, new))


def test_other_names_of_the_same_size_are_another_layout(tmp_path):
    samples = [JointSample(k, ("ab", "cd") if k % 2 else ("cd", "ab"), (k, -k)) for k in range(9)]
    messages = [("/a", s.stamp_ns, layout_of(s).pack(s)) for s in samples]
    recording = Recording.open(write_mcap(tmp_path / "a.mcap", messages))
    expected = [k if k % 2 else -k for k in range(9)]
    assert recording.joints("/a").column("position", "ab").tolist() == expected
    series = recording.tables({"/a": [("position", "ab")]})["/a"]
    assert series.column("position", "ab").tolist() == expected
