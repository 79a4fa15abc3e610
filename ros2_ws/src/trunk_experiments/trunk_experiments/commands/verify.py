"""``trunk verify``: whether a recording follows from itself."""

from __future__ import annotations

from pathlib import Path

import click

from trunk_msgs_util.files import resolve_path
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.units import seconds

from ..console.document import json_option, write_json
from ..console.options import file_option
from ..console.progress import progress_bar
from ..console.reading import reading, run_values
from ..console.tables import print_table
from ..errors import PlanError
from ..recorded.run import RecordedRun
from ..replay.doubts import refused, silence
from ..replay.signing import judge_signature, public_key
from ..replay.verdict import SignatureCheck
from ..replay.verify import Check, Verdict, describe, verify


def as_values(verdict: Verdict) -> dict[str, object]:
    """Return a verdict as plain values."""
    return {
        "verdict": verdict.word,
        "extent": verdict.judged or None,
        "parts": [
            {
                "name": part.name,
                "result": part.result,
                "steps_checked": part.steps,
                "steps_diverging": part.wrong_steps,
                "steps_not_judged": part.unjudged,
                "reason": part.reason or None,
                "from_s": None if part.from_ns is None else seconds(part.from_ns),
                "until_s": None if part.until_ns is None else seconds(part.until_ns),
                "first_divergence": [describe(d) for d in part.first],
            }
            for part in verdict.checks
        ],
        "altered": verdict.altered,
        "contradictions": verdict.contradictions,
        "obstacles": verdict.obstacles,
        "not_judged": verdict.unjudged,
        "notes": verdict.notes,
        "signature": _signature_values(verdict.signature),
    }


def _row(check: Check) -> tuple[str, ...]:
    """Return a check as a row: its name, its span in s, its steps and its result."""
    span = ["" if ns is None else f"{seconds(ns):g} s" for ns in (check.from_ns, check.until_ns)]
    result = f"{check.wrong_steps} diverge" if check.wrong_steps else check.result
    return check.name, *span, str(check.steps), result


def _signature_values(check: SignatureCheck | None) -> dict[str, object] | None:
    if check is None:
        return None
    return {
        "file": check.file,
        "valid": not check.fault,
        "trusted_key": check.trusted,
        "fingerprint": check.fingerprint or None,
        "fault": check.fault or None,
    }


def judged(run: Path, key: Path | None, signature: Path | None) -> tuple[Recording, Verdict]:
    """Return a recording and its verdict; a signature counts if asked for, or beside the recording.

    Raises KeyFileError, PlanError and RecordingError.
    """
    trusted = None if key is None else public_key(key)
    if signature and not signature.exists() and not key:
        raise PlanError(
            f"--signature {signature}: it does not exist: give a file written by trunk sign"
        )
    with reading(run) as tell:
        recording = Recording.open(run, tell, whole=True)
    with progress_bar(f"recomputing {resolve_path(run).name}"):
        verdict = verify(recording)
    judge_signature(verdict, recording, trusted, str(key), signature)
    return recording, verdict


@click.command("verify")
@click.argument("run", type=click.Path(path_type=Path))
@file_option(
    "--key",
    metavar="PUBLIC",
    help="The public Ed25519 key that must have signed it, as made by ssh-keygen.",
)
@file_option(
    "--signature",
    help="The signature.  [default: RUN.sig, beside the recording]",
)
@json_option("verify-1")
@click.pass_context
def command(
    ctx: click.Context, run: Path, key: Path | None, signature: Path | None, as_json: bool
) -> None:
    """Recompute every command of a recorded run and, where time was exact, every state.

    Exit code 0: verified; 1: something diverges, was altered, contradicts itself or is not signed by
    --key; 2: inconclusive, as something is missing. What no check covers is listed.
    """
    recording, verdict = judged(run, key, signature)
    if as_json:
        values = run_values(RecordedRun(recording), judged=verdict.word)
        write_json("verify-1", {**values, **as_values(verdict)})
        ctx.exit(verdict.exit_code)
    run_of = RecordedRun(recording)
    for line in filter(None, (silence(run_of), *refused(run_of))):
        click.echo(line)
    click.echo(f"{run}: {verdict.word}")
    if verdict.signature and (verdict.signature.trusted or verdict.signature.refuted):
        click.echo(f"  {verdict.signature.describe()}")
    for obstacle in verdict.obstacles:
        click.echo(f"  obstacle: {obstacle}")
    if verdict.judged:
        word = "recomputed all the same" if verdict.obstacles else "judged"
        click.echo(f"  {word}: {verdict.judged}")
    if verdict.checks:
        print_table("checks", ("check", "from", "to", "steps", "result"), map(_row, verdict.checks))
    for check in verdict.checks:
        for difference in check.first:
            click.echo(f"  {check.name}: first: {describe(difference)}")
    for part in verdict.altered:
        click.echo(f"  altered: {part}: not as the recorder wrote it, by its digest")
    for contradiction in verdict.contradictions:
        click.echo(f"  contradiction: {contradiction}")
    for part in verdict.unjudged:
        click.echo(f"  not judged: {part}")
    for note in verdict.notes:
        click.echo(f"  note: {note}")
    ctx.exit(verdict.exit_code)
