"""``trunk verify``: whether a recording follows from itself."""

from __future__ import annotations

from pathlib import Path

import click

from trunk_core.files import resolve_path
from trunk_evidence.judgement import verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.verdict import CheckedPart, Verdict, Verification, verification

from ..console.document import json_option, write_json
from ..console.reading import open_run
from ..console.tables import print_table
from ..console.terminal import progress_bar


def _row(part: CheckedPart) -> tuple[str, ...]:
    """Return a part as a row: its name, its span in s, its steps and its result."""
    span = ["" if t is None else f"{t:g} s" for t in (part.from_s, part.until_s)]
    diverging = part.steps_diverging
    result = f"{diverging} diverge" if diverging else part.result
    return part.name, *span, str(part.steps_checked), result


def judged(path: Path) -> tuple[RecordedRun, Verdict]:
    """Return a run and its verdict. Raises RecordingError."""
    run = open_run(path, whole=True)
    with progress_bar(f"recomputing {resolve_path(path).name}"):
        return run, verdict_on(run)


@click.command("verify")
@click.argument("run", type=click.Path(path_type=Path))
@json_option(Verification)
@click.pass_context
def command(ctx: click.Context, run: Path, as_json: bool) -> None:
    """Recompute every command of a recorded run and, where time was exact, every state.

    Exit code 0: verified; 1: something diverges or was altered; 2: inconclusive, as something is missing.
    What no check covers is listed.
    """
    recorded, verdict = judged(run)
    result = verification(recorded, verdict)
    if as_json:
        write_json(result)
        ctx.exit(verdict.exit_code)
    for line in result.doubts.of_inputs if result.doubts else ():
        click.echo(line)
    click.echo(f"{run}: {result.verdict}")
    for obstacle in result.obstacles:
        click.echo(f"  obstacle: {obstacle}")
    if result.extent:
        word = "recomputed all the same" if result.obstacles else "judged"
        click.echo(f"  {word}: {result.extent}")
    if result.parts:
        print_table("checks", ("check", "from", "to", "steps", "result"), map(_row, result.parts))
    for checked in result.parts:
        for difference in checked.first_divergence:
            click.echo(f"  {checked.name}: first: {difference}")
    for part in result.altered:
        click.echo(f"  altered: {part}: not as the recorder wrote it, by its digest")
    for part in result.not_judged:
        click.echo(f"  not judged: {part}")
    for note in result.notes:
        click.echo(f"  note: {note}")
    ctx.exit(verdict.exit_code)
