"""Who vouches for a recording: an Ed25519 signature (RFC 8032) over the digests of its content.

What is signed is a statement, the canonical JSON of ``{"digests": {...}, "format": "trunk-signature-1"}``:
keys sorted, no spaces, ASCII. The digests are those that a reader computes, so compression and chunks
are not part of it. The signature is kept in a file of its own, RUN.mcap.sig; the recording stays as it is.

Keys are in files: PEM, or as ssh-keygen writes them.
"""

from __future__ import annotations

import json
import os
import re
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey as Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey as Ed25519PublicKey
from cryptography.hazmat.primitives.hashes import SHA256

from ..errors import TrunkError
from ..files import resolve_path

_LIMIT = 1 << 16  # bytes; an Ed25519 key takes less than a thousand
_OPENSSH_PRIVATE = b"-----BEGIN OPENSSH PRIVATE KEY-----"
_WANTED = (
    "give an Ed25519 key, such as one made by `trunk sign --new-key` or `ssh-keygen -t ed25519`"
)
_TEXT = "utf-8"


class KeyFileError(TrunkError):
    """A file that cannot be used as a key: its name, why, and what to give instead."""


class NewKey(NamedTuple):
    """A key pair in OpenSSH's format, each the content of a file."""

    private: bytes
    public: bytes


def read_key(path: Path) -> bytes:
    """Return the content of a key's file. Raises KeyFileError."""
    try:
        with path.open("rb") as file:
            data = file.read(_LIMIT + 1)
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}: {_WANTED}") from None
    if len(data) > _LIMIT:
        raise KeyFileError(f"{path} is too large for a key: {_WANTED}")
    return data


def private_key(data: bytes, name: str, passphrase: Callable[[], bytes]) -> Ed25519PrivateKey:
    """Return the private key in a file's content: PEM (PKCS 8) or OpenSSH.

    ``name`` is the file's, for messages; ``passphrase`` is called if the key is encrypted. Raises
    KeyFileError, and whatever ``passphrase`` raises.
    """
    if b"PRIVATE KEY-----" not in data:
        if b"-----BEGIN PUBLIC KEY" in data or data.lstrip().startswith((b"ssh-", b"ecdsa-")):
            raise KeyFileError(f"{name} is a public key: give the private one")
        raise KeyFileError(f"{name} is not a private key: {_WANTED}")
    _only_one(data, name)
    is_openssh = _OPENSSH_PRIVATE in data
    load = serialization.load_ssh_private_key if is_openssh else serialization.load_pem_private_key
    try:
        try:
            key: object = load(data, None)
        except TypeError:  # cryptography's word for "encrypted"
            try:
                key = load(data, passphrase())
            except (TypeError, ValueError):  # TypeError: the passphrase is empty
                raise KeyFileError(
                    f"{name} cannot be decrypted: the passphrase is wrong, or the file is damaged"
                ) from None
    except ValueError:
        raise KeyFileError(f"{name} is damaged: {_WANTED}") from None
    except UnsupportedAlgorithm as error:
        raise KeyFileError(f"{name} cannot be read: {error}: {_WANTED}") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise _other_kind(name, key)
    return key


def public_key(data: bytes, name: str) -> Ed25519PublicKey:
    """Return the public key in a file's content: PEM or one line of OpenSSH. Raises KeyFileError."""
    if b"PRIVATE KEY-----" in data:
        raise KeyFileError(
            f"{name} is a private key: give the public one, and keep this one secret"
        )
    if b"-----BEGIN" not in data:
        return _openssh_public(data, name)
    _only_one(data, name)
    return _public(serialization.load_pem_public_key, data, name, "unknown")


def _public(load: Callable[[bytes], object], data: bytes, name: str, kind: str) -> Ed25519PublicKey:
    """Return the key that ``load`` reads from the data; ``kind`` names it in the error if not supported."""
    try:
        key = load(data)
    except ValueError:
        raise KeyFileError(f"{name} is not a public key: {_WANTED}") from None
    except UnsupportedAlgorithm:
        raise KeyFileError(f"{name} is a key of the kind {kind}: {_WANTED}") from None
    if not isinstance(key, Ed25519PublicKey):
        raise _other_kind(name, key)
    return key


def _openssh_public(data: bytes, name: str) -> Ed25519PublicKey:
    lines = [line for line in data.splitlines() if line.strip() and not line.startswith(b"#")]
    if len(lines) > 1:
        raise KeyFileError(f"{name} has {len(lines)} lines: give a file with one public key")
    line = lines[0].strip() if lines else b""
    kind = line.partition(b" ")[0].decode(_TEXT, "replace")
    return _public(serialization.load_ssh_public_key, line, name, kind)


def _only_one(data: bytes, name: str) -> None:
    count = data.count(b"-----BEGIN")
    if count > 1:
        raise KeyFileError(f"{name} has {count} entries: give a file with one key")


def _other_kind(name: str, key: object) -> KeyFileError:
    kind = re.sub(r"^_|(Private|Public)Key$", "", type(key).__name__)
    return KeyFileError(f"{name} is a key of the kind {kind}: {_WANTED}")


def fingerprint(key: Ed25519PublicKey) -> str:
    """Return a key's SHA-256 fingerprint, as ``ssh-keygen -l`` prints it."""
    digest = serialization.ssh_key_fingerprint(key, SHA256())
    return f"SHA256:{b64encode(digest).decode().rstrip('=')}"


def openssh_line(key: Ed25519PublicKey) -> str:
    """Return a public key as ``ssh-ed25519 AAAA...``."""
    line = key.public_bytes(serialization.Encoding.OpenSSH, serialization.PublicFormat.OpenSSH)
    return line.decode()


def parse_openssh_line(line: str) -> Ed25519PublicKey | None:
    """Return the key that `openssh_line` has written so; None for any other text."""
    try:
        key = _openssh_public(line.encode(), "")
    except (KeyFileError, UnicodeEncodeError):
        return None
    return key if openssh_line(key) == line else None


def new_key() -> NewKey:
    """Return a new key pair, not encrypted."""
    key = Ed25519PrivateKey.generate()
    private = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.OpenSSH,
        serialization.NoEncryption(),
    )
    return NewKey(private, f"{openssh_line(key.public_key())}\n".encode())


def write_new_key(path: Path) -> Path:
    """Write a new key pair: ``path``, for its owner alone, and ``path``.pub, which is returned.

    Raises KeyFileError if one of them exists, and OSError; neither file is then left behind.
    """
    public = path.with_name(f"{path.name}.pub")
    pair = new_key()
    made: list[Path] = []
    try:
        for target, data, mode in ((path, pair.private, 0o600), (public, pair.public, 0o644)):
            handle = os.open(target, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode)
            with os.fdopen(handle, "wb") as file:
                made.append(target)
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
    except BaseException as error:
        for target in made:
            with suppress(OSError):
                target.unlink()
        if isinstance(error, FileExistsError):
            raise KeyFileError(
                f"{error.filename} exists: a key is never replaced: name another file"
            ) from None
        raise
    return public


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
