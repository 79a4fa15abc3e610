"""Who vouches for a recording: an Ed25519 signature (RFC 8032) over the digests of its content.

What is signed is a statement, the canonical JSON of ``{"digests": {...}, "format": "trunk-signature-1"}``:
keys sorted, no spaces, ASCII. The digests are those that a reader computes, so compression and chunks
are not part of it. The signature is one line in a file of its own, RUN.mcap.sig: the format, the signer's
public key as OpenSSH writes it, and the value in base64. The recording stays as it is.
"""

from __future__ import annotations

import json
import os
import re
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.files import resolve_path
from trunk_msgs_util.recording.reader import Recording

from .verdict import ORIGIN, ORIGIN_SIGNED, SignatureCheck, Verdict

_FORMAT = "trunk-signature-1"
_LINE = re.compile(rb"trunk-signature-1 (ssh-ed25519 [A-Za-z0-9+/]{68}) ([A-Za-z0-9+/]{86}==)\n")
_LIMIT = 1 << 16  # bytes read of a file; a key or a signature takes some hundreds


class KeyFileError(TrunkError):
    """A file that cannot be used as a key: its name, why, and what to give instead."""


class SignatureError(TrunkError):
    """A file that is not a signature: why."""


class Signature(NamedTuple):
    """A signature, and the public key that it claims to fit."""

    key: Ed25519PublicKey
    value: bytes


def _read(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_LIMIT)


def private_key(path: Path, passphrase: Callable[[], bytes]) -> Ed25519PrivateKey:
    """Return the private key in a file of OpenSSH; ``passphrase`` is called if it is encrypted.

    Raises KeyFileError, and whatever ``passphrase`` raises.
    """
    why = "is not a private Ed25519 key of OpenSSH"
    try:
        data = _read(path)
        try:
            key = serialization.load_ssh_private_key(data, None)
        except TypeError:  # cryptography's word for "encrypted"
            why = "cannot be decrypted: the passphrase is wrong, or the file is damaged"
            key = serialization.load_ssh_private_key(data, passphrase())
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}: give a private key") from None
    except (TypeError, ValueError, UnsupportedAlgorithm):  # TypeError: an empty passphrase
        key = None
    if not isinstance(key, Ed25519PrivateKey):
        raise KeyFileError(f"{path} {why}: give one made by ssh-keygen -t ed25519") from None
    return key


def public_key(path: Path) -> Ed25519PublicKey:
    """Return the public key in a file of one line, as OpenSSH writes it. Raises KeyFileError."""
    try:
        data = _read(path).strip()
        key = None if b"\n" in data else serialization.load_ssh_public_key(data)
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}: give a public key") from None
    except (ValueError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PublicKey):
        raise KeyFileError(
            f"{path} is not one public Ed25519 key of OpenSSH: give a .pub file made by ssh-keygen -t ed25519"
        )
    return key


def _openssh(key: Ed25519PublicKey) -> str:
    line = key.public_bytes(serialization.Encoding.OpenSSH, serialization.PublicFormat.OpenSSH)
    return line.decode()


def fingerprint(key: Ed25519PublicKey) -> str:
    """Return a key's SHA-256 fingerprint, as ``ssh-keygen -l`` prints it."""
    digest = sha256(b64decode(_openssh(key).split()[1])).digest()
    return f"SHA256:{b64encode(digest).decode().rstrip('=')}"


def signature_path(recording: Path) -> Path:
    """Return the path of a recording's signature: beside it, RUN.mcap.sig."""
    return Path(f"{resolve_path(recording) if recording.name in ('', '..') else recording}.sig")


def statement(digests: Mapping[str, str]) -> bytes:
    """Return the bytes that are signed for a content with these digests."""
    content = {"format": _FORMAT, "digests": dict(digests)}
    return json.dumps(content, sort_keys=True, separators=(",", ":")).encode()


def sign(digests: Mapping[str, str], key: Ed25519PrivateKey) -> str:
    """Return the signature of a content with these digests, as the line that a file holds."""
    value = b64encode(key.sign(statement(digests))).decode()
    return f"{_FORMAT} {_openssh(key.public_key())} {value}\n"


def read_signature(path: Path) -> Signature:
    """Return the signature in a file. Raises SignatureError, without the file's name."""
    try:
        if not path.is_file():  # reading a pipe would block
            raise SignatureError("it does not exist, or is not a file")
        line = _LINE.fullmatch(_read(path))
        key = serialization.load_ssh_public_key(line[1]) if line else None
    except OSError as error:
        raise SignatureError(f"it cannot be read: {error.strerror}") from None
    except ValueError:
        key = None
    if not (line and isinstance(key, Ed25519PublicKey)):
        raise SignatureError(f"it is not one line of {_FORMAT}, as trunk sign writes it")
    return Signature(key, b64decode(line[2]))


def fits(signature: Signature, digests: Mapping[str, str]) -> bool:
    """Return True if the signature is of this content, by the key that it names."""
    try:
        signature.key.verify(signature.value, statement(digests))
    except InvalidSignature:
        return False
    return True


def judge_signature(
    verdict: Verdict,
    recording: Recording,
    key: Ed25519PublicKey | None = None,
    key_name: str = "",
    file: Path | None = None,
) -> None:
    """Add the signature to a verdict if one is asked for by its ``key``, or lies beside the recording.

    ``file``: where it is; None: the recording's name with ``.sig``. A signature that cannot be read is an
    obstacle; with a key it refutes.
    """
    file = file or signature_path(recording.path)
    if not key and not os.path.lexists(file):
        return
    signer, fault, other_content = key, "", False
    try:
        signature = read_signature(file)
        signer = key or signature.key
        if signature.key != signer:
            fault = f"{file} is by another key, {fingerprint(signature.key)}"
        elif uncovered := recording.undigestible():
            fault = f"{file} cannot cover {', '.join(uncovered)}"
        elif not fits(signature, recording.digested):
            whose, other_content = "it" if key else f"key {fingerprint(signer)}", True
            fault = f"the content is not what {whose} signed in {file}"
    except SignatureError as error:
        fault = f"{file}: {error}"
    signed_by = fingerprint(signer) if signer else None
    check = verdict.signature = SignatureCheck(
        str(file), not fault, key_name if key else None, signed_by, fault or None, other_content
    )
    if fault and not check.refuted:
        verdict.obstacles.append(
            f"{fault}: the signature cannot be judged; sign again, or move it away"
        )
    elif not fault and key:
        verdict.unjudged = [ORIGIN_SIGNED if part == ORIGIN else part for part in verdict.unjudged]
    elif not fault:
        verdict.notes.append(check.describe())
