"""A signature detects every change of a recording's content, and ignores how it is stored."""

from dataclasses import replace

import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType
from ros2_ws.src.trunk_experiments.test.keys import ALICE, MALLORY, WHO, refused
from ros2_ws.src.trunk_msgs_util.test.mcap_files import (
    ANEW,
    content,
    data_of,
    finish,
    record,
    records_of,
    write,
    write_file,
)

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.replay.signing import sign
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.recording.digests import ATTACHMENTS, DIGESTS
from trunk_msgs_util.recording.reader import Recording

from ..tampering.edits import edits_of


def test_another_signature_under_the_right_keys_name_is_refused(signed, trunk):
    sidecar = signed.parent / "run.mcap.sig"
    forged = sign(Recording.open(signed).digested, MALLORY).split()[-1]
    sidecar.write_text(f"{sidecar.read_text().rpartition(' ')[0]} {forged}\n")
    refused(trunk, "the content is not what it signed", "diverges")


EDITS = (
    ("one value", "/effort_command effort[0] middle times 1.1"),
    ("log times", "/joint_states one publish time + 1 ns"),
    ("order across topics", "two neighbours swapped"),
    ("messages", "/pid/state last dropped"),
    ("origin", "host, another"),
    ("end", "reason, another"),
    ("metadata", "a record more"),
    ("channels", "/joint_states metadata"),
    ("schemas", "sensor_msgs/msg/JointState text"),
    ("header", "library"),
)


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("edit", EDITS, ids=": ".join)
def test_the_signature_detects_every_edit_with_new_digests(signed, original, trunk, edit):
    found = content(original)
    next(each for each in edits_of(found) if each[:2] == edit).apply(found)
    write(found, signed, ANEW)
    assert not Recording.open(signed).alterations()
    code, out, _ = trunk("verify", "run.mcap")
    assert (code, out.splitlines()[0]) == (1, "run.mcap: diverges")
    assert f"signature: the content is not what key {WHO} signed in run.mcap.sig" in out
    refused(trunk, "the content is not what it signed in run.mcap.sig", "diverges")


def test_another_run_with_a_copied_signature_is_refused(signed, trunk):
    record_offline(make_plan("fig8", "lqr", everywhere={"duration": 0.05}), signed, overwrite=True)
    refused(trunk, "the content is not what it signed", "diverges")


def test_a_truncated_run_is_refused(signed, trunk):
    signed.write_bytes(signed.read_bytes()[: signed.stat().st_size // 2])
    refused(trunk, "the content is not what it signed", "diverges")


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.NONE, "chunk_size": 1000},
        {"compression": CompressionType.LZ4, "chunk_size": 1 << 20, "use_statistics": False},
        {"use_chunking": False},
    ],
    ids=["small chunks", "one chunk of LZ4", "no chunks"],
)
def test_the_signature_holds_for_the_same_content_written_anew(signed, original, trunk, options):
    write_file(content(original), signed, **options)
    assert signed.read_bytes() != original.read_bytes()
    code, out, err = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code == 0, out + err


def test_a_redescribed_channel_is_refused(signed, original, trunk):
    """Other readers would take true states for measured ones."""

    found = content(original)
    write_file(found, signed, use_chunking=False)
    whole = signed.read_bytes()
    measured, true = (found.channels[t] for t in ("/joint_states", "/ground_truth/joint_states"))
    swapped = replace(measured, topic=true.topic), replace(true, topic=measured.topic)
    first = next(at for kind, at, _ in records_of(whole) if kind == Opcode.MESSAGE)
    signed.write_bytes(finish(whole[:first] + record(*swapped) + data_of(whole)[first:]))
    refused(trunk, "the content is not what it signed", "diverges")


def test_what_no_digest_covers_is_neither_verified_nor_signed(signed, original, trunk):
    found = content(original)
    found.attachments.append(("notes.txt", b"first"))
    recording = write(found, signed, ANEW)
    assert recording.digests[ATTACHMENTS] == "1"
    (signed.parent / "run.mcap.sig").write_text(sign(recording.digested, ALICE))
    refused(trunk, "run.mcap.sig cannot cover the attachments' content")
    assert trunk("verify", "run.mcap")[0] == 2
    code, _, err = trunk("sign", "run.mcap", "--key", "alice", "--force", "--unverified")
    assert (code, "no digests of the attachments' content" in err) == (1, True)


def test_a_topic_named_like_a_part_is_not_covered(signed, original):
    found = content(original)
    found.channels["/joint_states"].topic = "heads"
    recording = write(found, signed, ANEW)
    assert "a topic with the name heads" in recording.undigested()


def test_the_recorded_digests_are_not_what_is_signed(signed, original, trunk):
    """A change to the recorded digests alone changes no content: verify notices it, not the signature."""
    found = content(original)
    found.values(DIGESTS)["heads"] = "00" * 32
    write(found, signed)
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert (code, out.splitlines()[0]) == (1, "run.mcap: diverges")
    assert f"  signed by {WHO}" in out
