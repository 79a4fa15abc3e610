"""Two key pairs, written as ssh-keygen writes them, and what `trunk verify --key` says where it refuses."""

from cryptography.hazmat.primitives import serialization as s
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from trunk_experiments.replay.signing import fingerprint

ALICE, MALLORY = (Ed25519PrivateKey.from_private_bytes(bytes([n]) * 32) for n in (1, 2))
WHO = fingerprint(ALICE.public_key())
OPENSSH = s.PrivateFormat.OpenSSH


def private_bytes(key, passphrase=None):
    kind = OPENSSH.encryption_builder().kdf_rounds(1)
    hidden = kind.build(passphrase) if passphrase else s.NoEncryption()
    return key.private_bytes(s.Encoding.PEM, OPENSSH, hidden)


def public_line(key):
    return key.public_key().public_bytes(s.Encoding.OpenSSH, s.PublicFormat.OpenSSH)


def write_key(path, key, passphrase=None):
    """Write a key pair, PATH and PATH.pub."""
    path.write_bytes(private_bytes(key, passphrase))
    path.with_suffix(".pub").write_bytes(public_line(key) + b" me@here\n")


def refused(trunk, fault, word="not signed"):
    code, out, _ = trunk("verify", "run.mcap", "--key", "alice.pub")
    assert code == 1
    assert out.startswith(f"run.mcap: {word}\n  not signed by {WHO} (alice.pub): ")
    assert fault in out.splitlines()[1]
