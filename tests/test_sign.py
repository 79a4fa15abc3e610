"""`trunk sign` and `trunk verify --key`: whose a recording is, against every change of its parts."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace

import pytest
from cryptography.hazmat.primitives import serialization as s
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from trunk_experiments import cli
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.recording.digests import ATTACHMENTS, DIGESTS
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.recording.signing.keys import Ed25519PrivateKey, fingerprint
from trunk_msgs_util.recording.signing.signature import sign, to_text
from trunk_msgs_util.recording.writer import END, PROVENANCE

from .edited import ANEW, NONE, content, copied, write

ALICE, MALLORY = (Ed25519PrivateKey.from_private_bytes(bytes([n]) * 32) for n in (1, 2))
FORMS = {
    "PEM": (s.PrivateFormat.PKCS8, s.Encoding.PEM, s.PublicFormat.SubjectPublicKeyInfo),
    "OpenSSH": (s.PrivateFormat.OpenSSH, s.Encoding.OpenSSH, s.PublicFormat.OpenSSH),
}
WHO = fingerprint(ALICE.public_key())


def write_key(path, key, form="OpenSSH", passphrase=None):
    """Write a key pair as others write it; return the private key's file."""
    private, encoding, public = FORMS[form]
    hidden = s.BestAvailableEncryption(passphrase) if passphrase else s.NoEncryption()
    path.write_bytes(key.private_bytes(s.Encoding.PEM, private, hidden))
    path.with_suffix(".pub").write_bytes(key.public_key().public_bytes(encoding, public))
    return path


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    path = tmp_path_factory.mktemp("sign") / "run.mcap"
    record_offline(make_plan("fig8", "pid", everywhere={"duration": 0.05}), path)
    return path


@pytest.fixture
def run(original, tmp_path, monkeypatch):
    """Return a copy of a short run, in the working directory, with the keys alice and mallory."""
    monkeypatch.chdir(tmp_path)
    write_key(tmp_path / "alice", ALICE)
    write_key(tmp_path / "mallory", MALLORY)
    (tmp_path / "run.mcap").write_bytes(original.read_bytes())
    return tmp_path / "run.mcap"


@pytest.fixture
def trunk(monkeypatch, capsys):
    """Return a function that runs the command and returns (exit code, output, errors)."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["trunk", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        return ended.value.code, out, err

    return call


@pytest.fixture
def signed(run, trunk):
    assert trunk("sign", "run.mcap", "--key", "alice")[0] == 0
    return run


@pytest.mark.parametrize("form", FORMS)
def test_a_signed_run_is_verified_as_signed_by_its_key(run, trunk, form):
    write_key(run.parent / "alice", ALICE, form)
    before = run.read_bytes()
    code, out, err = trunk("sign", "run.mcap", "--key", "alice")
    assert (code, out, err) == (0, f"run.mcap.sig: signed by {WHO}\n", "")
    assert run.read_bytes() == before
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code == 0
    assert out.startswith(f"run.mcap: verified\n  signed by {WHO} (alice.pub)\n")


def test_a_new_key_signs(run, trunk):
    code, out, _ = trunk("sign", "--new-key", "mine")
    assert code == 0
    assert "mine.pub: public key SHA256:" in out
    assert trunk("sign", "run.mcap", "--key", "mine")[0] == 0
    assert trunk("verify", "run.mcap", "--key", "mine.pub")[0] == 0


def test_who_vouches_for_the_origin(signed, trunk):
    """Nothing recomputes where a run was made: its digests cover it, and whoever signed vouches for it."""
    alone = "time): covered by digests alone\n"
    vouched = "time): covered by digests and the signature; the signer vouches for it\n"
    for words, said, unsaid in (
        ((), alone, vouched),
        (("--key", "alice.pub"), vouched, alone),
        (("--key", "mallory.pub"), alone, vouched),
    ):
        out = trunk("verify", "run.mcap", *words)[1]
        assert (said in out, unsaid in out) == (True, False), words


def test_a_signature_may_be_elsewhere(run, trunk):
    assert trunk("sign", "run.mcap", "--key", "alice", "-o", "else.sig")[0] == 0
    assert not (run.parent / "run.mcap.sig").exists()
    asked = ("verify", "run.mcap", "--signature", "else.sig")
    assert trunk(*asked, "--key", "alice.pub")[0] == 0
    assert f"signed by key {WHO} (else.sig)" in trunk(*asked)[1]
    code, _, err = trunk("verify", "run.mcap", "--signature", "none.sig")
    assert (code, "none.sig" in err) == (2, True)


def test_without_a_key_a_signature_is_only_noted(signed, trunk):
    code, out, _ = trunk("verify", "run.mcap")
    assert code == 0
    assert f"note: signed by key {WHO} (run.mcap.sig); --key PUBLIC checks whose it is" in out


def test_without_a_signature_nothing_is_said(run, trunk):
    code, out, _ = trunk("verify", "run.mcap")
    assert (code, "sign" in out) == (0, False)
    assert json.loads(trunk("verify", "run.mcap", "--json")[1])["signature"] is None


def test_the_result_for_programs(signed, trunk):
    def signature(*words):
        code, out, _ = trunk("verify", "run.mcap", "--json", *words)
        return code, json.loads(out)["verdict"], json.loads(out)["signature"]

    entry = {"file": "run.mcap.sig", "valid": True, "fingerprint": WHO, "fault": None}
    assert signature() == (0, "verified", {**entry, "trusted_key": None})
    assert signature("--key", "alice.pub") == (0, "verified", {**entry, "trusted_key": "alice.pub"})
    code, word, found = signature("--key", "mallory.pub")
    assert (code, word, found["valid"]) == (1, "not signed", False)
    assert found["fingerprint"] == fingerprint(MALLORY.public_key())
    assert found["fault"] == f"run.mcap.sig is by another key, {WHO}"


def refused(trunk, fault, word="not signed"):
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code == 1
    assert out.startswith(f"run.mcap: {word}\n  not signed by {WHO} (alice.pub): ")
    assert fault in out.splitlines()[1]


def test_a_missing_signature_is_refused(run, trunk):
    refused(trunk, "run.mcap.sig: it does not exist")


def test_a_signature_by_another_key_is_refused(run, trunk):
    assert trunk("sign", "run.mcap", "--key", "mallory")[0] == 0
    refused(trunk, f"run.mcap.sig is by another key, {fingerprint(MALLORY.public_key())}")


def test_another_signature_under_the_right_keys_name_is_refused(signed, trunk):
    sidecar = signed.parent / "run.mcap.sig"
    forged = json.loads(to_text(sign(Recording.open(signed).digested, MALLORY)))
    genuine = json.loads(sidecar.read_text())
    sidecar.write_text(json.dumps({**genuine, "signature": forged["signature"]}))
    refused(trunk, "the content is not what it signed", "diverges")


@pytest.mark.parametrize("text", ["", "{}", "-----BEGIN PGP SIGNATURE-----"])
def test_a_malformed_signature_is_refused_and_without_a_key_an_obstacle(signed, trunk, text):
    (signed.parent / "run.mcap.sig").write_text(text)
    refused(trunk, "run.mcap.sig: it ")
    code, out, _ = trunk("verify", "run.mcap")
    assert code == 2
    assert "obstacle: run.mcap.sig: it " in out


def edit_message(found):
    message = found.of("/effort_command")[10]
    message[2] = message[2][:-8] + bytes(8)


def edit_time(found):
    found.messages[30][3] += 1  # publish time


def edit_order(found):
    a, b = found.messages[20:22]
    found.messages[20:22] = [b, a]


EDITS = {
    "a message": edit_message,
    "a publish time": edit_time,
    "the order of topics": edit_order,
    "a message less": lambda found: found.messages.pop(),
    "the origin": lambda found: found.values(PROVENANCE).update(host="elsewhere"),
    "the end": lambda found: found.values(END).update(reason="another"),
    "a record more": lambda found: found.metadata.insert(1, ("note", {"by": "mallory"})),
    "a channel": lambda found: found.channels["/joint_states"].metadata.update(a="b"),
    "a schema": lambda found: setattr(next(iter(found.schemas.values())), "data", b"# other"),
    "the header": lambda found: setattr(found, "library", "other"),
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_every_edit_with_new_digests_is_told_by_the_signature(signed, original, trunk, edit):
    found = content(original)
    edit(found)
    write(found, signed, ANEW)
    assert not Recording.open(signed).alterations()
    code, out, _ = trunk("verify", "run.mcap")
    assert (code, out.splitlines()[0]) == (1, "run.mcap: diverges")
    assert f"signature: the content is not what key {WHO} signed in run.mcap.sig" in out
    refused(trunk, "the content is not what it signed in run.mcap.sig", "diverges")


def test_another_run_with_a_copied_signature_is_told(signed, trunk):
    record_offline(make_plan("fig8", "lqr", everywhere={"duration": 0.05}), signed, overwrite=True)
    refused(trunk, "the content is not what it signed", "diverges")


def test_a_truncated_run_is_told(signed, trunk):
    signed.write_bytes(signed.read_bytes()[: signed.stat().st_size // 2])
    refused(trunk, "the content is not what it signed", "diverges")


def write_anew(source, path, then=lambda writer, channels: None, **options):
    """Copy a recording with mcap's writer; ``then`` writes more after the channels."""
    with source.open("rb") as file, path.open("wb") as copy:
        reader, writer = make_reader(file), Writer(copy, **options)
        header, summary = reader.get_header(), reader.get_summary()
        writer.start(header.profile, header.library)
        for schema in summary.schemas.values():
            writer.register_schema(schema.name, schema.encoding, schema.data)
        for c in summary.channels.values():
            writer.register_channel(c.topic, c.message_encoding, c.schema_id, c.metadata)
        then(writer, {c.topic: c for c in summary.channels.values()})
        for _, _, m in reader.iter_messages(log_time_order=False):
            writer.add_message(m.channel_id, m.log_time, m.data, m.publish_time, m.sequence)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        writer.finish()


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.NONE, "chunk_size": 1000},
        {"compression": CompressionType.LZ4, "chunk_size": 1 << 20, "use_statistics": False},
        {"use_chunking": False},
    ],
    ids=["small chunks", "one chunk of LZ4", "no chunks"],
)
def test_written_anew_with_the_same_content_the_signature_holds(signed, original, trunk, options):
    write_anew(original, signed, **options)
    assert signed.read_bytes() != original.read_bytes()
    code, out, err = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code == 0, out + err


def test_a_channel_described_anew_does_not_pass_under_the_signature(signed, original, trunk):
    """Other readers would take true states for measured ones."""

    def swap(writer, channels):
        measured, true = (channels[t] for t in ("/joint_states", "/ground_truth/joint_states"))
        builder = getattr(writer, "_Writer__record_builder")  # noqa: B009
        replace(measured, topic=true.topic).write(builder)
        replace(true, topic=measured.topic).write(builder)

    write_anew(original, signed, swap, use_chunking=False)
    refused(trunk, "the content is not what it signed", "diverges")


def test_what_no_digest_covers_is_neither_verified_nor_signed(signed, original, trunk):
    found = content(original)
    found.attachments.append(("notes.txt", b"first"))
    recording = write(found, signed, ANEW)
    assert recording.digests[ATTACHMENTS] == "1"
    (signed.parent / "run.mcap.sig").write_text(to_text(sign(recording.digested, ALICE)))
    refused(trunk, "run.mcap.sig cannot cover the attachments' content", word="diverges")
    assert trunk("verify", "run.mcap")[0] == 1
    code, _, err = trunk("sign", "run.mcap", "--key", "alice", "--force", "--unverified")
    assert (code, "no digests of the attachments' content" in err) == (1, True)


def test_a_topic_named_as_a_part_is_not_covered(signed, original):
    found = content(original)
    found.channels["/joint_states"].topic = "heads"
    recording = write(found, signed, ANEW)
    assert "a topic with the name heads" in recording.undigested()


def test_only_verified_runs_are_signed_unless_told_otherwise(run, original, trunk):
    copied(original, run, lambda messages: messages.pop(len(messages) // 2), digests=ANEW)
    code, out, err = trunk("sign", "run.mcap", "--key", "alice")
    assert (code, out) == (1, "")
    assert err.startswith("trunk: error: run.mcap: ")
    assert "it is not signed; --unverified signs it all the same" in err
    assert not (run.parent / "run.mcap.sig").exists()
    code, _, err = trunk("sign", "run.mcap", "--key", "alice", "--unverified")
    assert (code, err.startswith("trunk: warning: run.mcap: ")) == (0, True)
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code != 0
    assert f"  signed by {WHO} (alice.pub)" in out


@pytest.mark.parametrize(
    ("break_it", "why"),
    [
        (lambda path, original: copied(original, path, digests=NONE), "it has no digests of "),
        (
            lambda path, original: copied(original, path, lambda m: m.pop()),
            "is not as its recorder wrote",
        ),
        (
            lambda path, _: path.write_bytes(path.read_bytes()[:-20]),
            "it is damaged: run.mcap: ends at",
        ),
    ],
    ids=["without digests", "altered", "damaged"],
)
def test_what_its_recorder_does_not_vouch_for_is_never_signed(run, original, trunk, break_it, why):
    break_it(run, original)
    code, _, err = trunk("sign", "run.mcap", "--key", "alice", "--unverified")
    assert (code, err.count("\n")) == (1, 1)
    assert why in err
    assert not (run.parent / "run.mcap.sig").exists()


def test_a_signature_is_replaced_only_by_force_and_nothing_else_ever(signed, trunk):
    sidecar = signed.parent / "run.mcap.sig"
    before = sidecar.read_text()
    code, _, err = trunk("sign", "run.mcap", "--key", "mallory")
    assert (code, "it exists" in err, sidecar.read_text()) == (2, True, before)
    assert trunk("sign", "run.mcap", "--key", "mallory", "--force")[0] == 0
    assert sidecar.read_text() != before
    for other in ("run.mcap", "alice"):
        kept = (signed.parent / other).read_bytes()
        code, _, err = trunk("sign", "run.mcap", "--key", "alice", "--force", "-o", other)
        assert (code, "is not a signature" in err) == (2, True)
        assert (signed.parent / other).read_bytes() == kept


@pytest.mark.parametrize(
    "words",
    [
        ("sign",),
        ("sign", "run.mcap"),
        ("sign", "--key", "alice"),
        ("sign", "run.mcap", "--new-key", "k"),
    ],
)
def test_words_that_do_not_go_together_are_refused(run, trunk, words):
    assert trunk(*words)[0] == 2
    assert not (run.parent / "k").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("sign", "run.mcap", "--key", "alice.pub"), "alice.pub is a public key"),
        (("verify", "run.mcap", "--key", "alice"), "alice is a private key"),
        (("sign", "run.mcap", "--key", "none"), "none: No such file"),
        (("verify", "run.mcap", "--key", "none"), "none: No such file"),
        (("sign", "--new-key", "alice"), "alice exists"),
        (("sign", "--new-key", "none/key"), "none/key: No such file"),
    ],
)
def test_a_wrong_key_is_one_line(run, trunk, words, why):
    code, out, err = trunk(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert why in err


def test_an_encrypted_key_asks_for_its_passphrase_in_a_terminal(run, trunk, monkeypatch):
    from trunk_experiments.commands import sign as module

    write_key(run.parent / "alice", ALICE, "PEM", b"secret")
    code, _, err = trunk("sign", "run.mcap", "--key", "alice")
    assert (code, "alice is encrypted, and there is no terminal" in err) == (2, True)

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stdin", Terminal())
    told = iter(["wrong", "secret"])
    monkeypatch.setattr(module.click, "prompt", lambda *_, **__: next(told))
    code, _, err = trunk("sign", "run.mcap", "--key", "alice")
    assert (code, "alice cannot be decrypted" in err) == (2, True)
    assert trunk("sign", "run.mcap", "--key", "alice")[0] == 0


def test_the_recorded_digests_are_not_what_is_signed(signed, original, trunk):
    """A change to the recorded digests alone changes no content: verify tells, not the signature."""
    found = content(original)
    found.values(DIGESTS)["heads"] = "00" * 32
    write(found, signed)
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert (code, out.splitlines()[0]) == (1, "run.mcap: diverges")
    assert f"  signed by {WHO}" in out
