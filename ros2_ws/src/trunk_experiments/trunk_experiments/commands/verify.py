"""``trunk verify``: whether a recording follows from itself."""

from __future__ import annotations

import json
from pathlib import Path

import click

from trunk_msgs_util.recording.reader import Recording

from ..replay.verify import Verdict, describe, verify
from .common import json_option


def as_values(verdict: Verdict) -> dict[str, object]:
    """Return a verdict as plain values."""
    return {
        "verdict": verdict.word,
        "parts": [
            {
                "name": part.name,
                "steps_checked": part.steps,
                "steps_diverging": part.wrong_steps,
                "first_divergence": [describe(d) for d in part.first],
            }
            for part in verdict.parts
        ],
        "altered": verdict.altered,
        "obstacles": verdict.obstacles,
        "notes": verdict.notes,
    }


@click.command("verify")
@click.argument("run", type=click.Path(path_type=Path))
@json_option()
@click.pass_context
def command(ctx: click.Context, run: Path, as_json: bool) -> None:
    """Recompute every command of a recorded run and, where time was exact, every state.

    Exit code 0: verified; 1: something diverges; 2: the run cannot be judged.
    """
    verdict = verify(Recording.open(run))
    if as_json:
        click.echo(json.dumps(as_values(verdict), indent=2))
        ctx.exit(verdict.exit_code)
    click.echo(f"{run}: {verdict.word}")
    for part in verdict.parts:
        outcome = f"{part.wrong_steps} diverge" if part.wrong_steps else "all equal to the last bit"
        click.echo(f"  {part.name}: {part.steps} steps checked, {outcome}")
        for difference in part.first:
            click.echo(f"    first: {describe(difference)}")
    for topic in verdict.altered:
        click.echo(f"  altered: {topic}: its messages are not the ones the recorder wrote")
    for obstacle in verdict.obstacles:
        click.echo(f"  obstacle: {obstacle}")
    for note in verdict.notes:
        click.echo(f"  note: {note}")
    ctx.exit(verdict.exit_code)
