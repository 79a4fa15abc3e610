"""Keys in files: PEM and OpenSSH are read, everything else is refused in one line."""

from __future__ import annotations

import shutil
import stat
import subprocess
from contextlib import suppress

import pytest
from cryptography.hazmat.primitives import serialization as s
from cryptography.hazmat.primitives.asymmetric import ec, ed448, rsa, x25519
from hypothesis import given
from hypothesis import strategies as st

from trunk_msgs_util.recording.signing import (
    Ed25519PrivateKey,
    KeyFileError,
    fingerprint,
    new_key,
    openssh_line,
    private_key,
    public_key,
    read_key,
    write_new_key,
)

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
PUBLIC = KEY.public_key()
PKCS8, OPENSSH = s.PrivateFormat.PKCS8, s.PrivateFormat.OpenSSH


def pem(key, form=PKCS8, passphrase=None):
    kind = OPENSSH.encryption_builder().kdf_rounds(1) if form is OPENSSH else None
    hidden = s.NoEncryption()
    if passphrase:
        hidden = kind.build(passphrase) if kind else s.BestAvailableEncryption(passphrase)
    return key.private_bytes(s.Encoding.PEM, form, hidden)


def public_pem(key):
    return key.public_key().public_bytes(s.Encoding.PEM, s.PublicFormat.SubjectPublicKeyInfo)


def public_line(key):
    return key.public_key().public_bytes(s.Encoding.OpenSSH, s.PublicFormat.OpenSSH)


def nothing():
    raise AssertionError("this key is not encrypted")


@pytest.mark.parametrize("form", [PKCS8, OPENSSH], ids=["PEM", "OpenSSH"])
def test_private_keys_are_read(form):
    assert private_key(pem(KEY, form), "k", nothing).private_bytes_raw() == bytes(range(32))


@pytest.mark.parametrize("form", [PKCS8, OPENSSH], ids=["PEM", "OpenSSH"])
def test_encrypted_keys_take_their_passphrase_only(form):
    data = pem(KEY, form, b"right")
    assert private_key(data, "k", lambda: b"right").private_bytes_raw() == bytes(range(32))
    for wrong in (b"wrong", b""):
        with pytest.raises(KeyFileError, match=r"^k cannot be decrypted: the passphrase is wrong"):
            private_key(data, "k", lambda wrong=wrong: wrong)


@pytest.mark.parametrize(
    "data",
    [
        public_pem(KEY),
        public_line(KEY),
        public_line(KEY) + b" me@here\n",
        b"# mine\n\n" + public_line(KEY) + b"\r\n",
    ],
    ids=["PEM", "OpenSSH", "with a comment", "among empty lines"],
)
def test_public_keys_are_read(data):
    assert public_key(data, "k.pub") == PUBLIC


OTHERS = {
    "RSA": lambda: rsa.generate_private_key(65537, 1024),
    "EC": lambda: ec.generate_private_key(ec.SECP256R1()),
    "Ed448": ed448.Ed448PrivateKey.generate,
    "X25519": x25519.X25519PrivateKey.generate,
}


@pytest.mark.parametrize(("kind", "make"), OTHERS.items(), ids=OTHERS)
def test_keys_of_another_kind_are_refused(kind, make):
    other = make()
    forms = [PKCS8, OPENSSH] if kind in ("RSA", "EC") else [PKCS8]
    publics = [public_pem(other)] + ([public_line(other)] if OPENSSH in forms else [])
    for form in forms:
        with pytest.raises(KeyFileError, match=f"^k is a key of the kind {kind}: give an Ed25519"):
            private_key(pem(other, form), "k", nothing)
    for data in publics:
        with pytest.raises(KeyFileError, match=f"^k is a key of the kind {kind}: give an Ed25519"):
            public_key(data, "k")


NO_PRIVATE = {
    "empty": (b"", "not a private key"),
    "text": (b"secret", "not a private key"),
    "a public key": (public_pem(KEY), "is a public key: give the private one"),
    "a public line": (public_line(KEY), "is a public key: give the private one"),
    "cut": (pem(KEY)[:60], "is damaged"),
    "cut, OpenSSH": (pem(KEY, OPENSSH)[:150], "is damaged"),
    "two": (pem(KEY) * 2, "has 2 entries"),
}


@pytest.mark.parametrize(("data", "word"), NO_PRIVATE.values(), ids=NO_PRIVATE)
def test_what_is_not_one_private_key_is_refused(data, word):
    with pytest.raises(KeyFileError, match=word) as raised:
        private_key(data, "k", nothing)
    assert "\n" not in str(raised.value)


NO_PUBLIC = {
    "empty": (b"", "not a public key"),
    "text": (b"key", "not a public key"),
    "binary": (bytes(range(256)), "k "),
    "a private key": (pem(KEY), "is a private key: give the public one"),
    "cut": (public_pem(KEY)[:60], "not a public key"),
    "two lines": (public_line(KEY) + b"\n" + public_line(KEY), "2 lines"),
    "two": (public_pem(KEY) * 2, "has 2 entries"),
    "a hardware key": (b"sk-ssh-ed25519@openssh.com AAAA", "give an Ed25519 key"),
    "a certificate": (
        b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n",
        "not a public",
    ),
}


@pytest.mark.parametrize(("data", "word"), NO_PUBLIC.values(), ids=NO_PUBLIC)
def test_what_is_not_one_public_key_is_refused(data, word):
    with pytest.raises(KeyFileError, match=word) as raised:
        public_key(data, "k")
    assert "\n" not in str(raised.value)


@given(st.binary(min_size=1, max_size=8), st.integers(0, 400), st.sampled_from([PKCS8, OPENSSH]))
def test_a_damaged_key_is_an_error_or_a_key(noise, place, form):
    whole = pem(KEY, form)
    data = whole[:place] + noise + whole[place + len(noise) :]
    for load in (lambda: private_key(data, "k", lambda: b"x"), lambda: public_key(data, "k")):
        with suppress(KeyFileError):
            load()


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "large").write_bytes(bytes(1 << 17))
    for path in (tmp_path / "none", tmp_path, tmp_path / "large"):
        with pytest.raises(KeyFileError) as raised:
            read_key(path)
        assert str(raised.value).startswith(str(path))


def test_a_new_pair_fits_and_is_for_its_owner_alone(tmp_path):
    path = tmp_path / "key"
    public = write_new_key(path)
    assert public == tmp_path / "key.pub"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    found = private_key(read_key(path), "key", nothing)
    assert found.public_key() == public_key(read_key(public), "key.pub")
    assert new_key().private != new_key().private


@pytest.mark.parametrize("taken", ["key", "key.pub"])
def test_a_new_key_replaces_nothing_and_leaves_nothing(tmp_path, taken):
    (tmp_path / taken).write_text("mine")
    with pytest.raises(KeyFileError, match=f"{taken} exists: a key is never replaced"):
        write_new_key(tmp_path / "key")
    assert [p.name for p in tmp_path.iterdir()] == [taken]
    assert (tmp_path / taken).read_text() == "mine"


@pytest.mark.skipif(
    shutil.which("ssh-keygen") is None, reason="no ssh-keygen: install openssh-client"
)
def test_ssh_keygen_and_this_read_each_others_keys(tmp_path):
    def ssh_keygen(*words):
        return subprocess.run(
            ["ssh-keygen", *words], cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout

    ssh_keygen("-q", "-t", "ed25519", "-N", "secret", "-a", "1", "-f", "theirs")
    theirs = public_key(read_key(tmp_path / "theirs.pub"), "theirs.pub")
    assert fingerprint(theirs) == ssh_keygen("-l", "-f", "theirs.pub").split()[1]
    mine = private_key(read_key(tmp_path / "theirs"), "theirs", lambda: b"secret")
    assert mine.public_key() == theirs
    write_new_key(tmp_path / "ours")
    ours = public_key(read_key(tmp_path / "ours.pub"), "ours.pub")
    assert ssh_keygen("-y", "-f", "ours").split()[:2] == openssh_line(ours).split()
