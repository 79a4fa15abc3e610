"""Who vouches for a recording: an Ed25519 signature (RFC 8032) over the digests of its content.

What is signed is a statement, the canonical JSON of ``{"digests": {...}, "format": "trunk-signature-1"}``:
keys sorted, no spaces, ASCII. The digests are those that a reader computes, so compression and chunks
are not part of it. The signature is kept in a file of its own, RUN.mcap.sig; the recording stays as it is.
"""

from __future__ import annotations

import json
from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cryptography.exceptions import InvalidSignature

from ...errors import TrunkError
from ...files import resolve_path
from .keys import (
    Ed25519PrivateKey,
    Ed25519PublicKey,
    fingerprint,
    openssh_line,
    parse_openssh_line,
)

FORMAT = "trunk-signature-1"
LIMIT = 1 << 16  # bytes of a signature's file; ours has some hundreds
SIZE = 64  # bytes of a signature

_FORMAT, _KEY, _FINGERPRINT, _SIGNATURE = "format", "public_key", "fingerprint", "signature"
_FIELDS = (_FORMAT, _KEY, _FINGERPRINT, _SIGNATURE)


class SignatureError(TrunkError):
    """A text that is not a signature: why."""


@dataclass(frozen=True)
class Signature:
    """A signature, and the public key that it claims to fit."""

    key: Ed25519PublicKey
    value: bytes

    @property
    def fingerprint(self) -> str:
        """The fingerprint of the key, computed."""
        return fingerprint(self.key)


def signature_path(recording: Path) -> Path:
    """Return the path of a recording's signature: beside it, RUN.mcap.sig."""
    named = recording if recording.name not in ("", "..") else resolve_path(recording)
    return named.with_name(f"{named.name}.sig") if named.name else named / ".sig"


def statement(digests: Mapping[str, str]) -> bytes:
    """Return the bytes that are signed for a content with these digests."""
    content = {_FORMAT: FORMAT, "digests": dict(digests)}
    return json.dumps(content, ensure_ascii=True, sort_keys=True, separators=(",", ":")).encode()


def sign(digests: Mapping[str, str], key: Ed25519PrivateKey) -> Signature:
    """Return the signature of a content with these digests."""
    return Signature(key.public_key(), key.sign(statement(digests)))


def fits(signature: Signature, digests: Mapping[str, str]) -> bool:
    """Return True if the signature is of this content, by the key that it names."""
    try:
        signature.key.verify(signature.value, statement(digests))
    except InvalidSignature:
        return False
    return True


def to_text(signature: Signature) -> str:
    """Return the content of a signature's file."""
    values = {
        _FORMAT: FORMAT,
        _KEY: openssh_line(signature.key),
        _FINGERPRINT: signature.fingerprint,
        _SIGNATURE: b64encode(signature.value).decode(),
    }
    return json.dumps(values, indent=2) + "\n"


def parse(data: bytes) -> Signature:
    """Return the signature in a file's content. Raises SignatureError if it is not as `to_text` writes it."""
    try:
        values = json.loads(data, object_pairs_hook=_unique)
    except (ValueError, RecursionError):
        raise SignatureError("it is not JSON") from None
    if not isinstance(values, dict) or _FORMAT not in values:
        raise SignatureError(f"it does not say its format, {FORMAT}")
    if values[_FORMAT] != FORMAT:
        raise SignatureError(f"its format is {values[_FORMAT]!r:.60}, this version reads {FORMAT}")
    if set(values) != set(_FIELDS) or not all(isinstance(v, str) for v in values.values()):
        raise SignatureError(f"it needs exactly these strings: {', '.join(_FIELDS)}")
    key = parse_openssh_line(values[_KEY])
    if key is None:
        raise SignatureError(f"{_KEY} is not an Ed25519 key")
    if values[_FINGERPRINT] != fingerprint(key):
        raise SignatureError(f"{_FINGERPRINT} is not that of {_KEY}")
    try:
        value = b64decode(values[_SIGNATURE], validate=True)
    except ValueError:
        raise SignatureError(f"{_SIGNATURE} is not base64") from None
    if len(value) != SIZE or b64encode(value).decode() != values[_SIGNATURE]:
        raise SignatureError(f"{_SIGNATURE} is not {SIZE} bytes in base64")
    return Signature(key, value)


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    values = dict(pairs)
    if len(values) != len(pairs):
        raise ValueError("a key appears twice")
    return values


def read(path: Path) -> Signature:
    """Return the signature in a file. Raises SignatureError, without the file's name."""
    try:
        if path.exists() and not path.is_file():
            raise SignatureError("it is not a file")  # reading a pipe would block
        with path.open("rb") as file:
            data = file.read(LIMIT + 1)
    except FileNotFoundError:
        raise SignatureError("it does not exist") from None
    except OSError as error:
        raise SignatureError(f"it cannot be read: {error.strerror}") from None
    if len(data) > LIMIT:
        raise SignatureError("it is too large for a signature")
    return parse(data)
