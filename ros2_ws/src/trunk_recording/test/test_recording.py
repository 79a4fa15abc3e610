import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_recording import schemas
from trunk_recording.cdr import layout_of
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.writer import RecordingWriter

from .mcap_files import records_of, write_mcap

TRUTH = f"/{topics.GROUND_TRUTH}"


def test_a_run_reads_back(run_file):
    path = run_file.write(20, parameters={"joints": ("hip", "trunk"), "max_effort": 5.0})
    recording = Recording.open(path)
    assert recording.warnings == []
    assert recording.complete
    assert recording.provenance == {"scenario": "fig6", "host": "größe"}
    topic = recording.topics[TRUTH]
    assert (topic.type, topic.count) == (topics.JOINT_STATE_TYPE, 21)
    assert (topic.first_stamp_ns, topic.last_stamp_ns) == (0, 20 * run_file.period_ns)
    assert topic.size == 21 * 116
    assert recording.topics["/fuzzy_pid/state"].count == 0
    joints = recording.joints(TRUTH)
    k = np.arange(21)
    assert joints.names == ("hip", "trunk")
    assert joints.stamp_ns.tolist() == (k * run_file.period_ns).tolist()
    assert joints.log_time_ns.tolist() == (k * run_file.period_ns + 5).tolist()
    assert joints.position.tolist() == [[i, i + 0.25] for i in range(21)]
    assert joints.velocity.tolist() == [[-i, -i - 0.5] for i in range(21)]
    command = recording.joints("/effort_command")
    assert command.column("effort", "trunk").tolist() == k.tolist()
    assert command.position.shape == (21, 0)
    assert np.isnan(command.column("position", "trunk")).all()
    assert np.isnan(command.column("effort", "hip")).all()
    assert len(recording.joints("/none")) == 0
    (given,) = recording.parameter_messages("/run/parameters")
    assert given.node == "/simulator"
    assert given.new == {"joints": ("hip", "trunk"), "max_effort": 5.0}
    assert [(e.node, e.message) for e in recording.events("/run/events")] == [
        ("/simulator", "started")
    ]


def write_joints(path, samples, encode=lambda sample: layout_of(sample).pack(sample)):
    with RecordingWriter(path) as writer:
        channel = writer.channel(TRUTH, topics.JOINT_STATE_TYPE)
        for sample in samples:
            writer.write(channel, sample.stamp_ns, sample.stamp_ns, encode(sample))
            writer.flush()
    return Recording.open(path).joints(TRUTH)


def test_changing_layouts_are_joined_by_name(tmp_path):
    samples = [
        JointSample(0, ("hip", "trunk"), (1.0, 2.0), (3.0, 4.0)),
        JointSample(1, ("trunk", "hip"), (6.0, 5.0), (8.0, 7.0)),
        JointSample(2, ("trunk", "neck"), (9.0, 10.0), effort=(11.0, 12.0)),
    ]
    joints = write_joints(tmp_path / "a.mcap", samples)
    nan = np.nan
    assert joints.names == ("hip", "trunk", "neck")
    expected = [[1, 2, nan], [5, 6, nan], [nan, 9, 10]]
    np.testing.assert_array_equal(joints.position, expected)
    np.testing.assert_array_equal(joints.velocity, [[3, 4, nan], [7, 8, nan], [nan] * 3])
    np.testing.assert_array_equal(joints.effort, [[nan] * 3, [nan] * 3, [nan, 11, 12]])


def two_joints(k, names=("a", "b"), count=2):
    sample = JointSample(k * 10**9, names, (1.0 * k,) * count)
    return layout_of(sample).pack(sample)


@pytest.mark.parametrize(
    ("odd", "why"),
    [
        (b"\x00\x01\x00\x00garbage", "ends before"),
        (b"", "not a little-endian CDR message"),
        (two_joints(7, count=3), "3 values of position for 2 names"),
        (two_joints(7, names=("a", "a")), "a name appears twice"),
        (two_joints(7, names=("a", "b" * 1025)), "1025 bytes, at most 1024 are read"),
        (
            two_joints(7, names=tuple(map(str, range(1025))), count=0),
            "1025 names, at most 1024 are read",
        ),
    ],
    ids=["garbage", "nothing", "three values", "one name", "a long name", "many names"],
)
def test_a_topic_with_a_bad_message_is_named_and_not_read(tmp_path, odd, why):
    messages = [two_joints(k) for k in range(5)]
    messages[3] = odd
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        channel = writer.channel(TRUTH, topics.JOINT_STATE_TYPE)
        for k, data in enumerate(messages):
            writer.write(channel, k * 10**9, 0, data)
            if k % 2:
                writer.flush()
    recording = Recording.open(path)
    (warning,) = recording.warnings
    assert warning.startswith(f"{TRUTH} is not read: message 3, logged at 3.000000000 s: ")
    assert why in warning
    with pytest.raises(RecordingError, match="is not read: message 3"):
        recording.joints(TRUTH)
    with pytest.raises(RecordingError, match="is not read: message 3"):
        recording.tables({TRUTH: [("position", "b")]})
    assert (recording.topics[TRUTH].count, recording.topics[TRUTH].readable) == (5, 0)
    assert recording.alterations() == []  # the recorder's digests are of all messages


def test_bad_events_and_parameters_are_named_and_not_read(tmp_path):
    empty = schemas.build(
        topics.DIAGNOSTIC_ARRAY_TYPE,
        header=schemas.build(
            "std_msgs/msg/Header",
            stamp=schemas.build("builtin_interfaces/msg/Time", sec=0, nanosec=0),
            frame_id="",
        ),
        status=[],
    )
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        events = writer.channel("/run/events", topics.DIAGNOSTIC_ARRAY_TYPE)
        given = writer.channel("/run/parameters", topics.PARAMETER_EVENT_TYPE)
        writer.write(events, 1, 0, schemas.event(5, "/simulator", "reset"))
        writer.write(events, 2, 0, schemas.serialize(topics.DIAGNOSTIC_ARRAY_TYPE, empty))
        for k in range(4):
            writer.write(given, 3 + k, 0, b"\x00\x01\x00\x00\xff")
        writer.write(given, 7, 0, schemas.parameter_event(0, "/pid", {"kp": 1.0}, {}))
    recording = Recording.open(path)
    assert recording.events("/run/events") == []
    assert recording.parameter_messages("/run/parameters") == []
    one, other = recording.warnings
    why = "message 1, logged at 0.000000002 s: a DiagnosticArray without a status"
    assert one == f"/run/events is not read: {why}"
    assert other.startswith("/run/parameters is not read: message 0, logged at 0.000000003 s: ")


def test_a_topic_of_another_type_is_a_recording_error(tmp_path):
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.write(writer.channel(TRUTH, "std_msgs/msg/String"), 0, 0, b"\0\1\0\0\1\0\0\0\0")
    recording = Recording.open(path)
    for read in (
        lambda: recording.joints(TRUTH),
        lambda: recording.tables({TRUTH: []}),
        lambda: recording.joint_names(TRUTH),
    ):
        with pytest.raises(RecordingError, match=r"a\.mcap: /ground_truth.* its type is std_msgs"):
            read()


def test_a_file_without_chunks_is_read(tmp_path):
    samples = [JointSample(k, ("a",), (float(k),)) for k in range(5)]
    messages = [(TRUTH, k, layout_of(one).pack(one)) for k, one in enumerate(samples)]
    path = write_mcap(tmp_path / "a.mcap", messages, use_chunking=False)
    assert Recording.open(path).joints(TRUTH).position.tolist() == [[0], [1], [2], [3], [4]]


def test_what_is_not_a_recording_gives_one_line_with_its_name(tmp_path):
    empty, text, other = (tmp_path / name for name in ("empty", "text", "short"))
    empty.write_bytes(b"")
    text.write_text("t,x,theta\n0,0,0\n")
    other.write_bytes(b"\x89MCAP")
    for path in (empty, text, other, tmp_path, tmp_path / "missing"):
        with pytest.raises(RecordingError) as caught:
            Recording.open(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_cut_file_is_its_valid_prefix(run_file):
    path = run_file.write(60, flush_every=10, parameters={"max_effort": 5.0})
    whole = Recording.open(path)
    truth, data = whole.joints(TRUTH), path.read_bytes()
    end_record = data.index(b"trunk_end")
    counts = []
    for size in [*range(9, len(data), 67), len(data) - 1]:
        path.write_bytes(data[:size])
        cut = Recording.open(path)
        assert any(f"ends at byte {size}" in warning for warning in cut.warnings)
        assert not (cut.complete and size < end_record)
        joints = cut.joints(TRUTH)
        n = len(joints)
        assert cut.topics.get(TRUTH, whole.topics[TRUTH]).count in (n, 61)
        assert joints.stamp_ns.tolist() == truth.stamp_ns[:n].tolist()
        assert joints.position.tolist() == truth.position[:n].tolist()
        counts.append(n)
    assert counts == sorted(counts)
    assert set(counts) == {0, 1, 11, 21, 31, 41, 51, 61}


def test_an_offset_in_a_warning_is_that_of_the_record(run_file):
    path = run_file.write(20, flush_every=5, compression="none")
    data = path.read_bytes()
    chunks = [at for opcode, at, _ in records_of(data) if opcode == 0x06]
    path.write_bytes(data[: chunks[0] + 50])
    assert f"inside the CHUNK record at byte {chunks[0]}" in Recording.open(path).warnings[0]
    altered = bytearray(data)
    altered[chunks[2] + 400] ^= 1  # inside a message: only the chunk's checksum can tell
    path.write_bytes(altered)
    recording = Recording.open(path)
    assert f"CHUNK record at byte {chunks[2]} is damaged" in recording.warnings[0]
    assert not recording.complete
    assert recording.joints(TRUTH).stamp_ns.tolist() == [k * run_file.period_ns for k in range(6)]


def test_a_file_altered_outside_chunks_is_not_complete(run_file):
    path = run_file.write(20)
    path.write_bytes(path.read_bytes().replace(b"fig6", b"fig7"))
    recording = Recording.open(path)
    assert "checksum" in recording.warnings[0]
    assert recording.end == {"complete": "true", "reason": "finished"}
    assert not recording.complete


@pytest.mark.slow
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    max_examples=300,
)
@given(st.data())
def test_a_damaged_file_never_raises_anything_else(run_file, data):
    if not run_file.path.exists():
        run_file.original = run_file.write(20, flush_every=7).read_bytes()
        run_file.truth = Recording.open(run_file.path).joints(TRUTH).position
    damaged = bytearray(run_file.original)
    at = data.draw(st.integers(0, len(damaged) - 1))
    damaged[at] ^= data.draw(st.integers(1, 255))
    run_file.path.write_bytes(damaged)
    try:
        recording = Recording.open(run_file.path)
        position = recording.joints(TRUTH).position
    except RecordingError:
        return
    is_prefix = position.tolist() == run_file.truth[: len(position)].tolist()
    assert is_prefix or not recording.complete
    data_end = run_file.original.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")
    assert recording.warnings or at >= data_end


def test_fifty_thousand_messages_are_read_by_a_few_calls(tmp_path):
    path, count = tmp_path / "a.mcap", 50_000
    with RecordingWriter(path) as writer:
        channel = writer.channel(TRUTH, topics.JOINT_STATE_TYPE)
        for k in range(count):
            sample = JointSample(k, ("hip", "trunk"), (k, k), (k, k), (0.0, k))
            writer.write(channel, k, k, layout_of(sample).pack(sample))
    calls = []
    sys.setprofile(lambda frame, event, of: calls.append(event))
    joints = Recording.open(path).joints(TRUTH)
    sys.setprofile(None)
    assert len(calls) < count  # and returns, of Python and of C: far less than one a message
    assert joints.column("effort", "trunk").tolist() == list(range(count))
