"""Ed25519 keys in files: PEM, or as ssh-keygen writes them."""

from __future__ import annotations

import os
import re
from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.hashes import SHA256

from ...errors import TrunkError

__all__ = [
    "Ed25519PrivateKey",
    "Ed25519PublicKey",
    "KeyFileError",
    "NewKey",
    "fingerprint",
    "new_key",
    "openssh_line",
    "parse_openssh_line",
    "private_key",
    "public_key",
    "read_key",
    "write_new_key",
]

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
