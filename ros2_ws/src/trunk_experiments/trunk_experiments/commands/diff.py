"""``trunk diff``: where two recorded runs, or two sweeps, diverge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NoReturn

import click

from trunk_core.results import Count, Result
from trunk_evidence.differences import FirstDifference, diff
from trunk_evidence.doubts import RecordingResult, about

from ..console.document import json_option, write_json
from ..console.reading import open_run, show_damage
from ..console.tables import print_table


@dataclass(frozen=True)
class DiffResult(Result, document="diff-1"):
    """The document of ``trunk diff A B``."""

    runs: tuple[RecordingResult, RecordingResult]
    identical: bool
    same_plan: Annotated[bool, "The same plan and versions: they should be equal"]
    messages_compared: Count
    differing_steps: Count
    first: Annotated[FirstDifference | None, "null: none"]
    parameters: Sequence[str]
    provenance: Sequence[str]
    record: Sequence[str]


@click.command("diff")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@json_option(DiffResult, "trunk_studies.sweep_results:StudyDiff")
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
        result = DiffResult(
            (about(first), about(second)),
            difference.identical,
            difference.same_plan,
            difference.compared,
            difference.differing_steps,
            difference.first,
            difference.parameters,
            difference.provenance,
            difference.record,
        )
        write_json(result)
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
    from trunk_studies.sweep_results import Results, diff_studies

    difference = diff_studies(Results.read(a), Results.read(b))
    if as_json:
        write_json(difference)
    else:
        click.echo(difference.describe())
        for line in difference.metadata:
            click.echo(f"  {line}")
    ctx.exit(0 if difference.identical else 1)
