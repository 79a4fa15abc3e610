"""``trunk export``: a recorded run as a table of numbers."""

from __future__ import annotations

from pathlib import Path

import click

from trunk_msgs_util.recording import Recording
from trunk_msgs_util.run_table import RunTable


@click.command("export")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--csv", "csv", required=True, type=click.Path(path_type=Path), help="The file to write."
)
def command(run: Path, csv: Path) -> None:
    """Write a recorded run as CSV: a row per state, full precision, SI units and radians."""
    recording = Recording.open(run)
    for warning in recording.warnings:
        click.echo(f"trunk: warning: {warning}", err=True)
    table = RunTable.from_recording(recording)
    table.write_csv(csv)
    click.echo(f"{csv}: {len(table.t)} rows")
