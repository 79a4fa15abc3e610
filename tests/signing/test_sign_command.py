"""`trunk sign` and `trunk verify --key`: who signed a recording, and what is not known or not allowed."""

import io
import json
import sys

import pytest
from ros2_ws.src.trunk_experiments.test.keys import ALICE, MALLORY, WHO, refused, write_key
from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, NONE, copied

from trunk_experiments.replay.signing import fingerprint


def test_a_signed_run_is_verified_as_signed_by_its_key(run, trunk):
    before = run.read_bytes()
    code, out, err = trunk("sign", "run.mcap", "--key", "alice")
    assert (code, out, err) == (0, f"run.mcap.sig: signed by {WHO}\n", "")
    assert run.read_bytes() == before
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code == 0
    assert out.startswith(f"run.mcap: verified\n  signed by {WHO} (alice.pub)\n")


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


def test_json_describes_the_signature(signed, trunk):
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


def test_a_missing_signature_is_refused(run, trunk):
    refused(trunk, "run.mcap.sig: it does not exist")


def test_a_signature_by_another_key_is_refused(run, trunk):
    assert trunk("sign", "run.mcap", "--key", "mallory")[0] == 0
    refused(trunk, f"run.mcap.sig is by another key, {fingerprint(MALLORY.public_key())}")


@pytest.mark.parametrize("text", ["", "{}", "-----BEGIN PGP SIGNATURE-----"])
def test_a_malformed_signature_is_refused_and_without_a_key_an_obstacle(signed, trunk, text):
    (signed.parent / "run.mcap.sig").write_text(text)
    refused(trunk, "run.mcap.sig: it ")
    code, out, _ = trunk("verify", "run.mcap")
    assert code == 2
    assert "obstacle: run.mcap.sig: it " in out


def test_only_verified_runs_are_signed_unless_told_otherwise(run, original, trunk):
    copied(original, run, lambda messages: messages.pop(len(messages) // 2), digests=ANEW)
    code, out, err = trunk("sign", "run.mcap", "--key", "alice")
    assert (code, out) == (1, "")
    assert err.startswith("trunk: error: run.mcap: ")
    assert "it is not signed; --unverified signs it anyway" in err
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


def test_force_replaces_a_signature_and_nothing_else(signed, trunk):
    sidecar = signed.parent / "run.mcap.sig"
    before = sidecar.read_text()
    code, _, err = trunk("sign", "run.mcap", "--key", "mallory")
    assert (code, "it exists" in err, sidecar.read_text()) == (2, True, before)
    assert trunk("sign", "run.mcap", "--key", "mallory", "--force")[0] == 0
    assert sidecar.read_text() != before
    for other, why in (
        ("run.mcap", "it is read by this command (run.mcap)"),
        ("alice", "it is read by this command (alice)"),
        ("mallory", "is not a signature"),
    ):
        kept = (signed.parent / other).read_bytes()
        code, _, err = trunk("sign", "run.mcap", "--key", "alice", "--force", "-o", other)
        assert (code, why in err) == (2, True)
        assert (signed.parent / other).read_bytes() == kept


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("sign", "run.mcap", "--key", "alice.pub"), "alice.pub is not a private Ed25519 key"),
        (("verify", "run.mcap", "--key", "alice"), "alice is not one public Ed25519 key"),
        (("sign", "run.mcap", "--key", "none"), "none: No such file"),
        (("verify", "run.mcap", "--key", "none"), "none: No such file"),
    ],
)
def test_a_wrong_key_gives_one_line(run, trunk, words, why):
    code, out, err = trunk(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert why in err


def test_an_encrypted_key_asks_for_its_passphrase_in_a_terminal(run, trunk, monkeypatch):
    from trunk_experiments.commands import sign as module

    write_key(run.parent / "alice", ALICE, b"secret")
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
