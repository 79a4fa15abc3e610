"""What ``trunk compare --study`` prints."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, fields
from math import isfinite
from pathlib import Path

import click

from ..console.document import write_json
from ..console.tables import print_table
from ..study.compare import PairedDifference, compare_study
from ..study.results import Results

HEADER = ("metric", "first - second", "pairs", "mean", "95 % interval", "smaller", "")


def show(path: Path, form: str | None, as_json: bool) -> None:
    """Print the differences between a sweep's controllers as a table, JSON, CSV or Markdown."""
    found = compare_study(Results.read(path))
    if as_json:
        differences = [as_values(d) for d in found]
        write_json("compare-study-1", {"study": path, "differences": differences})
    elif form == "csv":
        text = io.StringIO()
        writer = csv.DictWriter(
            text, [*(f.name for f in fields(PairedDifference)), "verdict"], lineterminator="\n"
        )
        writer.writeheader()
        writer.writerows(as_values(d) for d in found)
        click.echo(text.getvalue(), nl=False)
    elif form == "markdown":
        lines = [HEADER, ("---",) * len(HEADER), *(_cells(d) for d in found)]
        click.echo("\n".join(f"| {' | '.join(line)} |" for line in lines))
    else:
        title = f"{path}: first minus second, same grid point and draw, |quantity|"
        print_table(title, HEADER, [_cells(d) for d in found])


def as_values(difference: PairedDifference) -> dict[str, object]:
    """Return a difference as plain values; None for what does not exist."""
    values = {
        name: None if isinstance(value, float) and not isfinite(value) else value
        for name, value in asdict(difference).items()
    }
    return {**values, "verdict": difference.verdict}


def _cells(d: PairedDifference) -> tuple[str, ...]:
    told = d.low <= d.high
    return (
        d.metric,
        f"{d.first} - {d.second}",
        str(d.pairs),
        f"{d.mean:.3g}" if told else "",
        f"{d.low:.3g} … {d.high:.3g}" if told else "",
        f"{100.0 * d.smaller:.0f} %" if told else "",
        d.verdict,
    )
