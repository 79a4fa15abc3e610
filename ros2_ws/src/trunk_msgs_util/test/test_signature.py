"""Signatures over digests: the primitive against RFC 8032, statement and file against every change."""

from __future__ import annotations

import json
import os
from base64 import b64encode
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_msgs_util.recording.signing import (
    LIMIT,
    Ed25519PrivateKey,
    Ed25519PublicKey,
    Signature,
    SignatureError,
    fits,
    parse,
    read,
    sign,
    signature_path,
    statement,
    to_text,
)

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
DIGESTS = {"/joint_states": "ab" * 32, "heads": "cd" * 32}
SIGNATURE = sign(DIGESTS, KEY)
TEXT = to_text(SIGNATURE)

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
    "TEST 3": (
        "c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
        "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025",
        "af82",
        (
            "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac"
            "18ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a"
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


def test_the_statement_is_canonical_and_names_its_format():
    assert statement({"b": "2", "/a ü": "1"}) == (
        b'{"digests":{"/a \\u00fc":"1","b":"2"},"format":"trunk-signature-1"}'
    )
    assert statement({"b": "2", "a": "1"}) == statement({"a": "1", "b": "2"})


def test_the_value_in_the_file_is_ed25519_over_the_statement():
    expected = KEY.sign(statement(DIGESTS))
    assert json.loads(TEXT)["signature"] == b64encode(expected).decode()


def test_what_is_signed_fits_itself_and_reads_back():
    assert fits(SIGNATURE, DIGESTS)
    assert parse(TEXT.encode()) == SIGNATURE


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
    assert not fits(SIGNATURE, digests)


@given(st.integers(0, 511))
def test_no_flipped_bit_of_a_signature_fits(bit):
    value = bytearray(SIGNATURE.value)
    value[bit // 8] ^= 1 << bit % 8
    assert not fits(Signature(SIGNATURE.key, bytes(value)), DIGESTS)


def test_another_key_does_not_fit():
    other = Ed25519PrivateKey.from_private_bytes(bytes(32)).public_key()
    assert not fits(Signature(other, SIGNATURE.value), DIGESTS)


def changed(**values):
    return json.dumps({**json.loads(TEXT), **values}).encode()


OTHER = to_text(sign(DIGESTS, Ed25519PrivateKey.from_private_bytes(bytes(32))))
MALFORMED = {
    "empty": (b"", "not JSON"),
    "cut": (TEXT[:-5].encode(), "not JSON"),
    "binary": (b"\x89MCAP0\r\n\xff", "not JSON"),
    "deep": (b"[" * 60000, "not JSON"),
    "a field twice": (TEXT.replace("{", '{"format": "x",').encode(), "not JSON"),
    "a list": (b"[]", "does not say its format"),
    "no format": (b"{}", "does not say its format"),
    "another format": (changed(format="trunk-signature-2"), "'trunk-signature-2'"),
    "a format that is no text": (changed(format=["trunk-signature-1"]), "its format is"),
    "a field more": (changed(comment="by the director"), "needs exactly"),
    "a field less": (json.dumps({"format": "trunk-signature-1"}).encode(), "needs exactly"),
    "a number": (changed(signature=1), "needs exactly"),
    "no key": (changed(public_key="ssh-ed25519 AAAA"), "public_key"),
    "a key with a comment": (
        changed(public_key=json.loads(TEXT)["public_key"] + " me"),
        "public_key",
    ),
    "a surrogate": (changed(public_key="\ud800"), "public_key"),
    "another key": (changed(public_key=json.loads(OTHER)["public_key"]), "fingerprint is not"),
    "another fingerprint": (changed(fingerprint=json.loads(OTHER)["fingerprint"]), "fingerprint"),
    "no base64": (changed(signature="***"), "not base64"),
    "too short": (changed(signature="AAAA"), "64 bytes"),
    "other letters": (changed(signature="ü" * 88), "not base64"),
}


@pytest.mark.parametrize(("data", "word"), MALFORMED.values(), ids=MALFORMED)
def test_a_malformed_signature_says_why(data, word):
    with pytest.raises(SignatureError, match=word):
        parse(data)


@given(st.binary(max_size=60), st.integers(0, len(TEXT)))
def test_a_damaged_text_is_malformed_or_the_same_signature(noise, place):
    data = TEXT.encode()[:place] + noise + TEXT.encode()[place + len(noise) :]
    with suppress(SignatureError):
        assert parse(data) == SIGNATURE or not fits(parse(data), DIGESTS)


def test_what_is_not_a_signature_file_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(b" " * (LIMIT + 1))
    for name, word in (
        ("pipe", "not a file"),
        (".", "not a file"),
        ("large", "too large"),
        ("none", "not exist"),
    ):
        with pytest.raises(SignatureError, match=word):
            read(tmp_path / name)


def test_a_signature_is_beside_its_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert signature_path(tmp_path / "run.mcap") == tmp_path / "run.mcap.sig"
    assert signature_path(tmp_path.relative_to(tmp_path)) == tmp_path.with_name(
        tmp_path.name + ".sig"
    )
