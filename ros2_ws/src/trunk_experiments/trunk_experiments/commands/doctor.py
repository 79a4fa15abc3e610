"""``trunk doctor``: what is wrong with a recording, and where."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from ..console.common import json_option
from ..console.reading import progress_bar
from ..replay.doctor import ERROR, INFO, WARNING, Finding, examine

FINE, FINDINGS = 0, 1


def exit_code(found: list[Finding]) -> int:
    """Return 0 if there is nothing but information, 1 otherwise."""
    return FINDINGS if any(f.severity in (ERROR, WARNING) for f in found) else FINE


@click.command("doctor")
@click.argument("run", type=click.Path(path_type=Path))
@json_option()
@click.pass_context
def command(context: click.Context, run: Path, as_json: bool) -> None:
    """Report what is wrong with a recording: checksums, indexes, stamps, gaps, values, digests.

    Exit code: 0 nothing wrong, 1 findings, 2 unreadable.
    """
    with progress_bar(f"examining {run.resolve().name}") as tell:
        found = examine(run, tell)
    code = exit_code(found)
    if as_json:
        shown = [asdict(finding) for finding in found]
        click.echo(
            json.dumps({"file": str(run), "fine": code == FINE, "findings": shown}, indent=2)
        )
    else:
        for finding in found:
            click.echo(f"{finding.severity:7}  {finding.describe()}")
        counts = {s: sum(f.severity == s for f in found) for s in (ERROR, WARNING, INFO)}
        told = ", ".join(f"{n} {s}{'s' * (n != 1 and s != INFO)}" for s, n in counts.items() if n)
        click.echo(f"{run}: {'fine' if code == FINE else 'findings'}{f' ({told})' if told else ''}")
    context.exit(code)
