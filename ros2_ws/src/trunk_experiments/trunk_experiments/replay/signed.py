"""Is a recording signed, and by whom? The signature beside it against the content as it is read."""

from __future__ import annotations

import os
from pathlib import Path

from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.recording.signing import (
    Ed25519PublicKey,
    Signature,
    SignatureError,
    fingerprint,
    fits,
    read,
    signature_path,
)

from .verdict import ORIGIN, ORIGIN_SIGNED, SignatureCheck, Verdict


def check_signature(
    recording: Recording, file: Path, key: Ed25519PublicKey | None = None, key_name: str = ""
) -> SignatureCheck:
    """Return whether ``file`` is a signature of the recording's content, by ``key`` if one is given."""
    trusted = key_name if key else None
    try:
        signature = read(file)
    except SignatureError as error:
        key_fingerprint = fingerprint(key) if key else ""
        return SignatureCheck(str(file), trusted, key_fingerprint, f"{file}: {error}")
    fault, other_content = _fault(recording, file, signature, key)
    key_fingerprint = fingerprint(key or signature.key)
    return SignatureCheck(str(file), trusted, key_fingerprint, fault, other_content)


def judge_signature(
    verdict: Verdict,
    recording: Recording,
    key: Ed25519PublicKey | None = None,
    key_name: str = "",
    file: Path | None = None,
) -> None:
    """Add the signature to a verdict if one is asked for by its ``key``, or lies beside the recording.

    ``file``: where it is; None: the recording's name with ``.sig``.
    """
    file = file or signature_path(recording.path)
    if key or os.path.lexists(file):
        take_signature(verdict, check_signature(recording, file, key, key_name))


def _fault(
    recording: Recording, file: Path, signature: Signature, key: Ed25519PublicKey | None
) -> tuple[str, bool]:
    """Return why a signature does not count, empty if it does, and whether it is of other content."""
    if key and signature.key != key:
        return f"{file} is by another key, {signature.fingerprint}", False
    if uncovered := recording.undigestible():
        return f"{file} cannot cover {', '.join(uncovered)}", False
    if not fits(signature, recording.digested):
        whose = "it" if key else f"key {signature.fingerprint}"
        return f"the content is not what {whose} signed in {file}", True
    return "", False


def take_signature(verdict: Verdict, check: SignatureCheck) -> None:
    """Add a signature's check to a verdict.

    A signature that cannot be read is an obstacle; with a trusted key it refutes.
    """
    verdict.signature = check
    if check.trusted and not check.fault:
        verdict.unjudged = [ORIGIN_SIGNED if part == ORIGIN else part for part in verdict.unjudged]
    if not check.trusted and not check.fault:
        verdict.notes.append(check.describe())
    if check.fault and not check.refuted:
        verdict.obstacles.append(
            f"{check.fault}: the signature cannot be judged; sign again, or move it away"
        )
