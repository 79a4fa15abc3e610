import random
import struct

import pytest

from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_evidence.doctor import ERROR, INFO, WARNING, findings
from trunk_evidence.judgement import verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.commands.info import exit_code
from trunk_recording.cdr import JointStateLayout, layout_of
from trunk_recording.digests import PARTS
from trunk_recording.provenance import FORMAT
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.repair import recover
from trunk_recording.schemas import event, parameter_event
from trunk_recording.writer import PROVENANCE, RecordingWriter

from ...trunk_recording.test.mcap_files import ANEW, content, copied, each, records_of, write

TRUTH = f"/{topics.GROUND_TRUTH}"
MS = 1_000_000

TERMS = law_named("pid").record_names


def write_run(path, stamps=range(20), value=float, end=True, provenance=True, parameters=True):
    """Write a run whose true states have these stamps in ms and values computed from them."""
    writer = RecordingWriter(path, "none", overwrite=True)
    if provenance:
        writer.add_metadata(PROVENANCE, {"mode": "offline", "format": FORMAT, "scenario": "fig6"})
    channels = {
        topic: writer.channel(f"/{topic}", type_name)
        for topic, type_name in topics.evidence_types(("pid",)).items()
    }
    for node in ("simulator", "pid") if parameters else ():
        data = parameter_event(0, f"/{node}", {"update_rate": 1000.0}, {})
        writer.write(channels[topics.RUN_PARAMETERS], 0, 0, data)
    writer.write(channels[topics.RUN_EVENTS], 0, 0, event(0, "/simulator", "started"))
    for i, k in enumerate(stamps):
        both = (0.0, 0.0)
        sample = JointSample(round(k * MS), ("hip", "trunk"), (0.5, value(k)), both, both)
        writer.write(channels[topics.GROUND_TRUTH], i, i, layout_of(sample).pack(sample))
        seen = JointSample(i * MS, ("hip", "trunk"), both, both, both)
        writer.write(channels[topics.JOINT_STATES], i, i, layout_of(seen).pack(seen))
        command = JointSample(i * MS, ("trunk",), effort=(0.0,))
        writer.write(channels[topics.EFFORT_COMMAND], i, i, layout_of(command).pack(command))
        state = JointSample(i * MS, TERMS, (1.0,) * len(TERMS))
        writer.write(channels["pid/state"], i, i, layout_of(state).pack(state))
        if i % 5 == 4:
            writer.flush()
    if end:
        writer.finish(complete=True, reason="finished")
    else:
        writer._file.close()
    return path


def said(path):
    return [finding.describe() for finding in findings(RecordedRun.open(path))]


def test_a_sound_run_has_no_findings(tmp_path, short_run):
    assert findings(RecordedRun.open(write_run(tmp_path / "a.mcap"))) == []
    assert findings(RecordedRun.open(short_run())) == []
    assert exit_code([]) == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            {"stamps": [0, 1, 2, 6, 7]},
            f"{TRUTH}, t = 0.002 s: steps are missing after this stamp: 3",
        ),
        ({"stamps": [0, 1, 1, 2]}, f"{TRUTH}, t = 0.001 s: the stamp appears twice"),
        ({"stamps": [0, 2, 1, 3]}, f"{TRUTH}, t = 0.001 s: the stamp is earlier"),
        (
            {"value": lambda k: float("nan") if k == 7 else 1.0},
            f"{TRUTH}, t = 0.007 s: position[trunk] is nan",
        ),
        (
            {"value": lambda k: float("inf") if k > 7 else 1.0},
            f"{TRUTH}, t = 0.008 s: position[trunk] is inf: 12 times in all, the last at t = 0.019 s",
        ),
        ({"provenance": False}, "no provenance: scenario"),
        ({"parameters": False}, "no parameters of pid: the run cannot be rebuilt"),
        ({"end": False}, "no trunk_end record"),
    ],
)
def test_findings_name_their_place(tmp_path, options, says):
    found = findings(RecordedRun.open(write_run(tmp_path / "a.mcap", **options)))
    assert any(finding.describe().startswith(says) for finding in found), found
    assert exit_code(found) == 1


@pytest.mark.parametrize(
    ("periods", "missing"), [(1.0, 0), (1.49, 0), (1.51, 1), (2.49, 1), (2.51, 2), (3.0, 2)]
)
def test_a_gap_is_more_than_one_and_a_half_periods(tmp_path, periods, missing):
    found = findings(
        RecordedRun.open(write_run(tmp_path / "a.mcap", stamps=[0, 1, 2, 2 + periods, 3 + periods]))
    )
    says = [f"steps are missing after this stamp: {missing} at a period of 1 ms"] if missing else []
    assert [(f.stamp_ns, f.message) for f in found] == [(2 * MS, text) for text in says]


@pytest.mark.parametrize(
    ("opcode", "within", "says"),
    [
        (6, 200, "its checksum is wrong"),
        (12, 60, "the checksum of the first"),
        (7, 20, "the message index is not that of the chunk's messages"),
        (8, 25, "the summary's chunks are not those of the data"),
        (11, 20, "the checksum of summary and footer is wrong"),
        (2, 20, "the checksum of summary and footer is wrong"),
    ],
)
def test_one_flipped_bit_is_found_where_it_is(tmp_path, opcode, within, says):
    path = write_run(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    at = next(at for o, at, _ in records_of(data) if o == opcode)
    data[at + within] ^= 1
    path.write_bytes(data)
    found = [f for f in findings(RecordedRun.open(path)) if says in f.message]
    assert found, said(path)
    assert found[0].severity == ERROR
    if opcode == 6:
        assert found[0].byte == at


def test_an_altered_message_is_found_by_its_digest(tmp_path):
    """All checksums are right and there is an index: only the digest can tell."""
    path = write_run(tmp_path / "a.mcap")
    found = content(path)
    message = found.of(TRUTH)[3]
    message[2] = message[2][:-12] + b"\1" + message[2][-11:]
    forged = write(found, tmp_path / "b.mcap").path
    found = [
        f.message for f in findings(RecordedRun.open(forged)) if f.severity in (ERROR, WARNING)
    ]
    assert f"{TRUTH}: not as the recorder wrote it (digest)" in found
    assert not any("/pid/state:" in message for message in found)


def test_recover_saves_all_but_the_damaged_chunk(tmp_path):
    path = write_run(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    chunks = [(at, end) for opcode, at, end in records_of(data) if opcode == 6]
    data[chunks[1][0] + 300] ^= 1
    path.write_bytes(data)
    recovery = recover(path, tmp_path / "b.mcap")
    assert recovery.messages[TRUTH] == 15
    assert any(f"byte {chunks[1][0]} is damaged" in line for line in recovery.lost)
    saved = Recording.open(tmp_path / "b.mcap")
    assert saved.joints(TRUTH).stamp_ns.tolist() == [k * MS for k in (*range(5), *range(10, 20))]
    assert not saved.complete
    assert saved.end["recovered"] == "true"
    assert saved.provenance == {"mode": "offline", "format": FORMAT, "scenario": "fig6"}
    # Digests of the whole run would flag the remaining messages as altered.
    assert saved.digests == {}
    assert saved.alterations() == []
    assert not [f for f in findings(RecordedRun.open(tmp_path / "b.mcap")) if f.byte is not None]


def test_recover_resumes_after_a_record_without_an_end(tmp_path):
    path = write_run(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    chunks = [at for opcode, at, _ in records_of(data) if opcode == 6]
    data[chunks[0] + 1 : chunks[0] + 9] = struct.pack("<Q", 1 << 40)  # the first chunk's length
    path.write_bytes(data)
    recovery = recover(path, tmp_path / "b.mcap")
    assert recovery.messages[TRUTH] == 15
    joints = Recording.open(tmp_path / "b.mcap").joints(TRUTH)
    assert joints.position[:, 1].tolist() == [float(k) for k in range(5, 20)]


def test_recover_finishes_a_cut_file(tmp_path):
    path = write_run(tmp_path / "a.mcap", end=False)
    path.write_bytes(path.read_bytes()[:-50])
    recovery = recover(path, tmp_path / "b.mcap")
    assert recovery.messages[TRUTH] >= 15
    assert len(recovery.lost) == 1
    assert [f.message for f in findings(RecordedRun.open(tmp_path / "b.mcap"))] == [
        f"incomplete: recovered; it was: no end; lost: {recovery.lost[0]}"
    ]


def test_recover_keeps_the_digests_if_no_message_is_lost(tmp_path):
    path = write_run(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    data[next(at for opcode, at, _ in records_of(data) if opcode == 2) + 20] ^= 1  # the footer
    path.write_bytes(data)
    assert Recording.open(path).digests
    recovery = recover(path, tmp_path / "b.mcap")
    saved = Recording.open(tmp_path / "b.mcap")
    assert recovery.messages[TRUTH] == 20
    before = Recording.open(path).digests
    assert saved.digests == {k: v for k, v in before.items() if k.startswith("/")}
    assert saved.alterations() == []
    assert saved.undigested() == list(PARTS.values())


def test_recover_refuses_what_it_must(tmp_path):
    path = write_run(tmp_path / "a.mcap")
    with pytest.raises(FileExistsError, match="the broken file itself"):
        recover(path, path, overwrite=True)
    other = tmp_path / "b.mcap"
    other.write_text("mine")
    with pytest.raises(FileExistsError, match="choose another name"):
        recover(path, other)
    assert other.read_text() == "mine"
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(RecordingError, match="nothing was recovered"):
        recover(path, tmp_path / "c.mcap")
    assert not (tmp_path / "c.mcap").exists()


@pytest.mark.slow
def test_any_damage_can_be_examined_and_recovered(tmp_path):
    """Damage anywhere gives findings, never another exception; what is recovered is correct and sound."""
    path, output = write_run(tmp_path / "a.mcap"), tmp_path / "b.mcap"
    data = path.read_bytes()
    data_end = data.rindex(struct.pack("<BQ", 15, 4))
    chosen = random.Random(5)
    for i in range(120):
        at = chosen.randrange(8, len(data))
        broken = bytearray(data[:at] if i % 3 == 0 else data)
        if i % 3:
            broken[at] ^= 1 << chosen.randrange(8)
        path.write_bytes(broken)
        found = findings(RecordedRun.open(path))
        assert exit_code(found) == 1 or at > data_end, at
        output.unlink(missing_ok=True)
        try:
            recover(path, output, overwrite=True)
        except RecordingError:
            assert not output.exists()
            continue
        joints = Recording.open(output).joints(TRUTH)
        assert joints.position[:, 1].tolist() == [stamp / MS for stamp in joints.stamp_ns]
        assert not [f for f in findings(RecordedRun.open(output)) if f.byte is not None]


def renamed(run, path, topic, names=None, without=()):
    """Copy a run with other joints on a topic, or without some of its quantities."""

    def edit(name, data, index):
        if f"/{name}" != topic:
            return data
        sample = JointStateLayout.parse(data).unpack(data)
        sample = sample._replace(**dict.fromkeys(without, ()), name=names or sample.name)
        return layout_of(sample).pack(sample)

    copied(run, path, each(edit), ANEW)
    return path


@pytest.mark.parametrize(
    ("topic", "change", "says"),
    [
        ("/joint_states", {"without": ["velocity"]}, "no velocity in any message"),
        (TRUTH, {"without": ["position"]}, "no position in any message"),
        ("/effort_command", {"without": ["effort"]}, "no effort in any message"),
        ("/joint_states", {"names": ("a", "b")}, "no joint 'trunk', which pid names, only a, b"),
        (TRUTH, {"names": ("a", "b")}, "no joint 'hip', which simulator names, only a, b"),
        ("/effort_command", {"names": ("elbow",)}, "no joint 'trunk', which pid names, only elbow"),
    ],
)
def test_what_cannot_be_recomputed_is_named(tmp_path, short_run, topic, change, says):
    path = renamed(short_run("fig8", "pid", duration=0.3), tmp_path / "a.mcap", topic, **change)
    found = findings(RecordedRun.open(path))
    assert exit_code(found) == 1
    assert f"{topic}: {says}: the run cannot be recomputed" in "\n".join(
        finding.describe() for finding in found
    )


def test_of_references_for_one_state_the_last_counts_and_none_is_a_fault(tmp_path, short_run):
    """Who drags the ring of the live page gives several while a state lasts."""
    found = content(short_run("fig8", "pid", duration=0.3))
    for number, k in enumerate((3, 3, 5)):
        sample = JointSample(k * MS, ("trunk",), (0.1 * number,))
        data = layout_of(sample).pack(sample)
        found.messages.append([f"/{topics.REFERENCE}", k * MS, data, k * MS, 0])
    path = write(found, tmp_path / "a.mcap", ANEW).path
    (finding,) = [f for f in findings(RecordedRun.open(path)) if f.topic == f"/{topics.REFERENCE}"]
    assert (finding.severity, finding.message) == (INFO, "the stamp appears twice")


def test_a_bad_message_is_named(tmp_path, short_run):
    found = content(short_run("fig8", "pid", duration=0.3))
    found.messages.append(["/run/events", 5, b"\0\1\0\0", 5, 0])
    recording = write(found, tmp_path / "a.mcap", ANEW)
    refused, without = findings(RecordedRun.open(recording.path))
    assert refused.message.startswith("/run/events is not read: message 2, logged at ")
    assert without.message == "no events: the run cannot be judged"
    verdict = verify(recording)
    assert not any(check.wrong_steps for check in verdict.checks)
    assert verdict.obstacles[0] == refused.message
