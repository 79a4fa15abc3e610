"""``trunk diff``: where two recorded runs, or two sweeps, diverge."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import click

from ..console.document import json_option, write_json
from ..console.reading import open_run, run_values, show_damage
from ..console.tables import print_table
from ..replay.diff import diff


@click.command("diff")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@json_option("diff-1", "diff-study-1")
@click.pass_context
def command(ctx: click.Context, a: Path, b: Path, as_json: bool) -> None:
    """Compare two recorded runs topic by topic, by stamp, bit by bit; or two sweeps, run by run.

    Exit code 0: identical; 1: they differ.
    """
    if _is_sweep(a) or _is_sweep(b):
        _diff_studies(ctx, a, b, as_json)
    first, second = open_run(a), open_run(b)
    for run in (first, second):
        show_damage(run, f"{run.path}: ")
    difference = diff(first, second)
    if as_json:
        values = {
            "runs": [run_values(first), run_values(second)],
            "identical": difference.identical,
            "same_plan": difference.same_plan,
            "messages_compared": difference.compared,
            "differing_steps": difference.differing_steps,
            "first": None if difference.first is None else difference.first._asdict(),
            "parameters": difference.parameters,
            "provenance": difference.provenance,
            "record": difference.record,
        }
        write_json("diff-1", values)
        ctx.exit(0 if difference.identical else 1)
    if difference.first is None:
        click.echo(f"identical: {difference.compared} messages, bit for bit")
    else:
        click.echo(
            f"different at {difference.differing_steps} steps; first at {difference.describe()}"
        )
    for title, lines in (
        ("parameters", difference.parameters),
        ("provenance", difference.provenance),
        ("record", difference.record),
    ):
        for line in lines:
            click.echo(f"  {title}: {line}")
    for name, (head, *rows) in difference.tables.items():
        click.echo()
        print_table(f"{name}: from A to B", head, rows)
    ctx.exit(0 if difference.identical else 1)


def _is_sweep(path: Path) -> bool:
    """Return True for a Parquet file, whatever its name."""
    try:
        if not path.is_file():  # reading a pipe would block
            return False
        with path.open("rb") as file:
            return file.read(4) == b"PAR1"
    except OSError:  # reported by who reads it
        return False


def _diff_studies(ctx: click.Context, a: Path, b: Path, as_json: bool) -> NoReturn:
    from ..study.results import Results, diff_studies

    difference = diff_studies(Results.read(a), Results.read(b))
    if as_json:
        values = {
            "studies": [a, b],
            "identical": difference.identical,
            "runs_compared": difference.compared,
            "differing_runs": difference.differing,
            "first": None if difference.first is None else difference.first._asdict(),
            "furthest_ulps": difference.furthest,
            "metadata": difference.metadata,
        }
        write_json("diff-study-1", values)
    else:
        click.echo(difference.describe())
        for line in difference.metadata:
            click.echo(f"  {line}")
    ctx.exit(0 if difference.identical else 1)
