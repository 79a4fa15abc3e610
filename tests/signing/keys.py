"""Two key pairs, written as others write them, and what `trunk verify --key` says where it refuses."""

from __future__ import annotations

from cryptography.hazmat.primitives import serialization as s

from trunk_msgs_util.recording.signing import Ed25519PrivateKey, fingerprint

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


def refused(trunk, fault, word="not signed"):
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code == 1
    assert out.startswith(f"run.mcap: {word}\n  not signed by {WHO} (alice.pub): ")
    assert fault in out.splitlines()[1]
