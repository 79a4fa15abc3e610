"""``trunk sign``: who vouches for a recording."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_msgs_util.files import atomic_write
from trunk_msgs_util.recording.reader import Recording

from ..console.document import json_option, write_json
from ..console.options import file_option
from ..console.outputs import check_output
from ..console.terminal import show_warnings
from ..errors import NotSignedError, PlanError
from ..recorded.run import RecordedRun
from ..replay.doubts import RecordingResult, about
from ..replay.signing import (
    KeyFileError,
    SignatureError,
    fingerprint,
    private_key,
    read_signature,
    sign,
    signature_path,
)
from ..replay.verify import VERIFIED, Verdict, verify


@dataclass(frozen=True)
class SignResult(RecordingResult, document="sign-1"):
    """The document of ``trunk sign RUN``."""

    signature: Annotated[Path, "The file"]
    fingerprint: str
    reasons: Annotated[Sequence[str], "Why it is not verified; empty if it is"]


@click.command("sign")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--key",
    type=click.Path(path_type=Path),
    metavar="FILE",
    required=True,
    help="Your private Ed25519 key, as made by ssh-keygen -t ed25519.",
)
@file_option(
    "-o",
    "--output",
    help="The signature to write.  [default: RUN.sig, beside the recording]",
)
@click.option("--force", is_flag=True, help="Replace a signature that exists.")
@click.option("--unverified", is_flag=True, help="Sign even if trunk verify does not verify it.")
@json_option(SignResult)
def command(
    run: Path, key: Path, output: Path | None, force: bool, unverified: bool, as_json: bool
) -> None:
    """Sign a recording's content with an Ed25519 key; the signature is a file beside it.

    The signature covers the content (messages, their times and order, channels, metadata), not its
    compression. The recording stays as it is. `trunk verify RUN --key PUBLIC` checks the signature.
    """
    target = output or signature_path(run)
    _check_target(target, force, run, key)
    signer = private_key(key, lambda: _passphrase(key))
    recording = Recording.open(run)
    _check_content(recording)
    verdict = verify(recording)
    _check_verdict(run, verdict, unverified)
    with atomic_write(target, overwrite=force) as part:
        part.write_text(sign(recording.digested, signer), encoding="ascii")
    signed_by = fingerprint(signer.public_key())
    if as_json:
        subject = vars(about(RecordedRun(recording), judged=verdict.word))
        write_json(
            SignResult(**subject, signature=target, fingerprint=signed_by, reasons=verdict.reasons)
        )
    else:
        click.echo(f"{target}: signed by {signed_by}")


def _passphrase(key: Path) -> bytes:
    if not sys.stdin.isatty():
        raise KeyFileError(
            f"{key} is encrypted, and there is no terminal to ask for its passphrase: "
            "sign in a terminal, or give a key that is not encrypted"
        )
    passphrase: str = click.prompt(f"passphrase of {key}", hide_input=True, err=True)
    return passphrase.encode()


def _check_target(target: Path, force: bool, run: Path, key: Path) -> None:
    """Raise PlanError if the signature may not be written there: only a signature is ever replaced."""
    check_output(target, force=force, inputs=[run, key])
    if target.is_file():
        try:
            read_signature(target)
        except SignatureError as error:
            raise PlanError(
                f"--output {target}: it exists and is not a signature ({error}): "
                "name another file, or move it away"
            ) from None


def _check_content(recording: Recording) -> None:
    """Raise NotSignedError for content that is not signed even with --unverified."""
    if recording.damage:
        raise NotSignedError(
            f"{recording.path} is not signed because it is damaged: {recording.damage[0]}: "
            "record the run again, or restore the file"
        )
    if recording.seen_otherwise:
        raise NotSignedError(
            f"{recording.path} is not signed because its index or summary is not that of its data: "
            f"{recording.seen_otherwise[0]}: trunk recover writes both anew"
        )
    if uncovered := recording.undigested():
        raise NotSignedError(
            f"{recording.path} is not signed because it has no digests of {', '.join(uncovered)}: "
            "give a recording as the recorder or trunk simulate wrote it"
        )
    if altered := recording.alterations():
        raise NotSignedError(
            f"{recording.path} is not signed because it is not as its recorder wrote it, "
            f"by the digests of {', '.join(altered)}: restore the file"
        )


def _check_verdict(run: Path, verdict: Verdict, unverified: bool) -> None:
    if verdict.exit_code == VERIFIED:
        return
    why = f"{run}: {verdict.word}: {'; '.join(verdict.reasons) or 'nothing was recomputed'}"
    if not unverified:
        raise NotSignedError(f"{why}: it is not signed; --unverified signs it anyway")
    show_warnings([f"{why}: signed anyway"])
