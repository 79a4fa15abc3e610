"""Keys of OpenSSH and signatures over digests: RFC 8032, the statement, the files against every change."""

import os
import shutil
import subprocess
from base64 import b64encode
from contextlib import suppress

import pytest
from cryptography.hazmat.primitives import serialization as s
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from hypothesis import given
from hypothesis import strategies as st

from trunk_experiments.replay.signing import (
    KeyFileError,
    Signature,
    SignatureError,
    fingerprint,
    fits,
    private_key,
    public_key,
    read_signature,
    sign,
    signature_path,
    statement,
)

from .keys import ALICE, MALLORY, private_bytes, public_line

PUBLIC = ALICE.public_key()
DIGESTS = {"/joint_states": "ab" * 32, "heads": "cd" * 32}
TEXT = sign(DIGESTS, ALICE).encode()
VALUE = ALICE.sign(statement(DIGESTS))

# RFC 8032, section 7.1: secret key, public key, message, signature.
RFC_8032 = {
    "TEST 1": (
        "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
        "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
        "",
        (
            "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e06522490155"
            "5fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b"
        ),
    ),
    "TEST 2": (
        "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
        "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
        "72",
        (
            "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
            "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00"
        ),
    ),
}


@pytest.mark.parametrize(
    ("secret", "public", "message", "expected"), RFC_8032.values(), ids=RFC_8032
)
def test_the_primitive_is_that_of_rfc_8032(secret, public, message, expected):
    key = Ed25519PrivateKey.from_private_bytes(bytes.fromhex(secret))
    assert key.public_key() == Ed25519PublicKey.from_public_bytes(bytes.fromhex(public))
    assert key.sign(bytes.fromhex(message)).hex() == expected


def nothing():
    raise AssertionError("this key is not encrypted")


@pytest.fixture
def file(tmp_path):
    """Return a function that writes bytes into the file k."""

    def write(data):
        (tmp_path / "k").write_bytes(data)
        return tmp_path / "k"

    return write


def test_private_keys_are_read(file):
    assert private_key(file(private_bytes(ALICE)), nothing).public_key() == PUBLIC


def test_encrypted_keys_take_their_passphrase_only(file):
    path = file(private_bytes(ALICE, b"right"))
    assert private_key(path, lambda: b"right").public_key() == PUBLIC
    for wrong in (b"wrong", b""):
        with pytest.raises(KeyFileError, match=r"k cannot be decrypted: the passphrase is wrong"):
            private_key(path, lambda wrong=wrong: wrong)


@pytest.mark.parametrize("after", [b"", b" me@here\n", b"\r\n"])
def test_public_keys_are_read(file, after):
    assert public_key(file(public_line(ALICE) + after)) == PUBLIC


PEM = ALICE.private_bytes(s.Encoding.PEM, s.PrivateFormat.PKCS8, s.NoEncryption())
OTHERS = [rsa.generate_private_key(65537, 1024), ec.generate_private_key(ec.SECP256R1())]
NO_PRIVATE = {
    "empty": b"",
    "text": b"secret",
    "PEM": PEM,
    "a public key": public_line(ALICE),
    "cut": private_bytes(ALICE)[:150],
    "RSA": private_bytes(OTHERS[0]),
    "EC": private_bytes(OTHERS[1]),
}
NO_PUBLIC = {
    "empty": b"",
    "text": b"key",
    "binary": bytes(range(256)),
    "large": bytes(1 << 17),
    "a private key": private_bytes(ALICE),
    "PEM": PUBLIC.public_bytes(s.Encoding.PEM, s.PublicFormat.SubjectPublicKeyInfo),
    "cut": public_line(ALICE)[:60],
    "two": public_line(ALICE) + b"\n" + public_line(MALLORY),
    "a hardware key": b"sk-ssh-ed25519@openssh.com AAAA",
    "a signature": TEXT,
    "RSA": public_line(OTHERS[0]),
    "EC": public_line(OTHERS[1]),
}


@pytest.mark.parametrize("data", NO_PRIVATE.values(), ids=NO_PRIVATE)
def test_what_is_not_a_private_key_is_refused(file, data):
    with pytest.raises(KeyFileError, match="k is not a private Ed25519 key of OpenSSH: give one"):
        private_key(file(data), nothing)


@pytest.mark.parametrize("data", NO_PUBLIC.values(), ids=NO_PUBLIC)
def test_what_is_not_one_public_key_is_refused(file, data):
    with pytest.raises(KeyFileError, match="k is not one public Ed25519 key of OpenSSH: give a"):
        public_key(file(data))


@given(st.binary(min_size=1, max_size=8), st.integers(0, 400))
def test_a_damaged_key_is_an_error_or_a_key(tmp_path_factory, noise, place):
    whole = private_bytes(ALICE)
    path = tmp_path_factory.getbasetemp() / "damaged"
    path.write_bytes(whole[:place] + noise + whole[place + len(noise) :])
    for load in (lambda: private_key(path, lambda: b"x"), lambda: public_key(path)):
        with suppress(KeyFileError):
            load()


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    for path in (tmp_path / "none", tmp_path):
        for load in (
            lambda path=path: private_key(path, nothing),
            lambda path=path: public_key(path),
        ):
            with pytest.raises(KeyFileError) as raised:
                load()
            assert str(raised.value).startswith(f"{path}: ")


@pytest.mark.skipif(
    shutil.which("ssh-keygen") is None, reason="no ssh-keygen: install openssh-client"
)
def test_keys_of_ssh_keygen_are_read(tmp_path):
    def ssh_keygen(*words):
        return subprocess.run(
            ["ssh-keygen", *words], cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout

    ssh_keygen("-q", "-t", "ed25519", "-N", "secret", "-a", "1", "-f", "mine")
    public = public_key(tmp_path / "mine.pub")
    assert fingerprint(public) == ssh_keygen("-l", "-f", "mine.pub").split()[1]
    assert private_key(tmp_path / "mine", lambda: b"secret").public_key() == public


def test_the_statement_is_canonical_and_names_its_format():
    assert statement({"b": "2", "/a ü": "1"}) == (
        b'{"digests":{"/a \\u00fc":"1","b":"2"},"format":"trunk-signature-1"}'
    )
    assert statement({"b": "2", "a": "1"}) == statement({"a": "1", "b": "2"})


def test_a_signature_is_a_line_of_format_key_and_value_over_the_statement(file):
    assert b" ".join((b"trunk-signature-1", public_line(ALICE), b64encode(VALUE) + b"\n")) == TEXT
    assert read_signature(file(TEXT)) == Signature(PUBLIC, VALUE)
    assert fits(Signature(PUBLIC, VALUE), DIGESTS)


@pytest.mark.parametrize(
    "digests",
    [
        {},
        {**DIGESTS, "heads": "ce" * 32},
        {**DIGESTS, "/extra": "00" * 32},
        {"heads": DIGESTS["heads"]},
        {"/joint_states": DIGESTS["heads"], "heads": DIGESTS["/joint_states"]},
    ],
    ids=["none", "another", "one more", "one less", "exchanged"],
)
def test_other_digests_do_not_fit(digests):
    assert not fits(Signature(PUBLIC, VALUE), digests)


@given(st.integers(0, 511))
def test_no_flipped_bit_of_a_signature_fits(bit):
    value = bytearray(VALUE)
    value[bit // 8] ^= 1 << bit % 8
    assert not fits(Signature(PUBLIC, bytes(value)), DIGESTS)


def test_another_key_does_not_fit():
    assert not fits(Signature(MALLORY.public_key(), VALUE), DIGESTS)


MALFORMED = {
    "empty": b"",
    "cut": TEXT[:-5],
    "binary": b"\x89MCAP0\r\n\xff",
    "twice": TEXT * 2,
    "another format": TEXT.replace(b"signature-1", b"signature-2"),
    "a word more": TEXT[:-1] + b" me@here\n",
    "a public key": public_line(ALICE) + b"\n",
    "another kind": TEXT.replace(b"ssh-ed25519", b"ssh-rsa"),
    "no such key": TEXT.replace(b"AAAAC3", b"AAAAC4"),
    "too short": TEXT.replace(b64encode(VALUE), b"AAAA"),
    "large": TEXT + b" " * (1 << 17),
}


@pytest.mark.parametrize("data", MALFORMED.values(), ids=MALFORMED)
def test_what_is_not_a_signature_is_refused(file, data):
    with pytest.raises(SignatureError, match="it is not one line of trunk-signature-1"):
        read_signature(file(data))


@given(st.binary(max_size=60), st.integers(0, len(TEXT)))
def test_a_damaged_text_is_malformed_or_the_same_signature(tmp_path_factory, noise, place):
    path = tmp_path_factory.getbasetemp() / "damaged.sig"
    path.write_bytes(TEXT[:place] + noise + TEXT[place + len(noise) :])
    with suppress(SignatureError):
        signature = read_signature(path)
        assert signature == (PUBLIC, VALUE) or not fits(signature, DIGESTS)


def test_what_is_no_file_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", ".", "none"):
        with pytest.raises(SignatureError, match="it does not exist, or is not a file"):
            read_signature(tmp_path / name)


def test_a_signature_is_beside_its_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert signature_path(tmp_path / "run.mcap") == tmp_path / "run.mcap.sig"
    assert signature_path(tmp_path.relative_to(tmp_path)) == tmp_path.with_name(
        tmp_path.name + ".sig"
    )
