"""``trunk compare``: runs side by side."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import click

from ..analysis.metrics import QUANTITIES, MetricText
from ..console.document import json_option, write_json
from ..console.reading import open_views, show_warnings_of
from ..console.tables import print_table
from ..views.compare import Comparison, Row, compare
from ..views.task import not_ranked

_LONGEST = 20  # values of an array that are listed


@click.command("compare")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@json_option("compare-1")
@click.option("--csv", "form", flag_value="csv", help="Print the metrics as CSV.")
@click.option("--markdown", "form", flag_value="markdown", help="Print Markdown tables.")
@click.pass_context
def command(ctx: click.Context, runs: tuple[Path, ...], form: str | None, as_json: bool) -> None:
    """Compare recorded runs: metrics, parameters, and where each diverges from the first.

    The best value of each row, the smallest in magnitude, is marked; what never happened ranks last. A run
    that fell, is incomplete, or did not keep real time is reported first and never marked. If plant, start,
    reference, disturbances or length differ between the runs, none is marked.
    """
    if as_json and form:
        ctx.fail(f"--json and --{form}: give one of them")
    views = open_views(runs)
    found = compare(views)
    if as_json or form is not None:
        show_warnings_of(views)
    if as_json:
        write_json("compare-1", as_values(found, [view.path for view in views]))
    elif form == "csv":
        click.echo(as_csv(found), nl=False)
    elif form == "markdown":
        click.echo(as_markdown(found))
    else:
        for line in doubtful(found):
            click.echo(line)
        show_warnings_of(views)
        _show(found)


def divergences(found: Comparison) -> list[tuple[str, str]]:
    """Return, for each run after the first, its name and where it diverges from the first."""
    return [(name, d.describe()) for name, d in zip(found.names[1:], found.diffs, strict=True)]


def as_values(found: Comparison, files: Sequence[Path]) -> dict[str, object]:
    """Return a comparison of the runs in some files as plain values; ``best`` holds names of runs."""
    return {
        "runs": [
            {
                "name": name,
                "file": file,
                "doubts": one.as_values(),
                "branch": None if branch is None else branch._asdict(),
            }
            for name, file, one, branch in zip(
                found.names, files, found.doubts, found.branches, strict=True
            )
        ],
        "different_tasks": list(found.tasks),
        "metrics": {
            row.key: {
                "unit": _quantity(row.key).unit,
                "values": list(row.values),
                "best": [found.names[i] for i in row.best],
            }
            for row in found.rows
        },
        "parameters": {name: list(values) for name, values in found.parameters.items()},
        "first_divergence": {
            name: None if d.first is None else d.first._asdict()
            for name, d in zip(found.names[1:], found.diffs, strict=True)
        },
    }


def as_csv(found: Comparison) -> str:
    """Return the metrics as CSV in full precision; empty if a quantity does not exist."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["quantity", "unit", *found.names, "best"])
    for row in found.rows:
        values = ["" if value is None else repr(value) for value in row.values]
        best = "; ".join(found.names[i] for i in row.best)
        writer.writerow([row.key, _quantity(row.key).unit, *values, best])
    return text.getvalue()


def as_markdown(found: Comparison) -> str:
    """Return the metrics, the best in bold, and the differing parameters as Markdown tables."""
    lines = [f"- **{line}**" for line in doubtful(found)]
    lines += [""] if lines else []
    lines += [_line(("quantity", "unit", *found.names)), _line(("---",) * (2 + len(found.names)))]
    for row in found.rows:
        shown = [
            f"**{number(row, i)}**" if i in row.best else number(row, i)
            for i in range(len(row.values))
        ]
        quantity = _quantity(row.key)
        lines.append(_line((quantity.label, quantity.unit, *shown)))
    if found.parameters:
        lines += ["", _line(("parameter", *found.names)), _line(("---",) * (1 + len(found.names)))]
        lines += [_line((k, *map(setting, v))) for k, v in found.parameters.items()]
    told = [*branched(found), *divergences(found)]
    lines += ["", *(f"- {name}: {where}" for name, where in told)]
    return "\n".join(lines).rstrip()


def branched(found: Comparison) -> list[tuple[str, str]]:
    """Return the name of each run that is a branch, and of which run it is one."""
    return [
        (name, one.describe())
        for name, one in zip(found.names, found.branches, strict=True)
        if one is not None
    ]


def _line(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _quantity(key: str) -> MetricText:
    return QUANTITIES.get(key, MetricText(key, ""))


def number(row: Row, run: int) -> str:
    """Return a run's metric as text."""
    value = row.values[run]
    return row.missing[run] if value is None else f"{value:.6g}"


def setting(value: object) -> str:
    """Return a parameter's value as text, a dash if a run has none."""
    if isinstance(value, tuple):
        more = f", … ({len(value)} in all)" if len(value) > _LONGEST else ""
        return "[" + ", ".join(map(setting, value[:_LONGEST])) + more + "]"
    if isinstance(value, float):
        return f"{value:.6g}"
    return "–" if value is None else str(value)


def doubtful(found: Comparison) -> list[str]:
    """Return a line for each doubt about a run, and one if the runs are not ranked."""
    lines = [
        f"{name}: {line}"
        for name, one in zip(found.names, found.doubts, strict=True)
        for line in one.lines
    ]
    return [*filter(None, [not_ranked(found.tasks)]), *lines]


def _show(found: Comparison) -> None:
    told = "* best; doubtful runs are not ranked" if any(found.doubts) else "* best"
    print_table(
        f"metrics ({'not ranked' if found.tasks else told})",
        ("quantity", *found.names, "unit"),
        [
            (
                _quantity(row.key).label,
                *(
                    f"{'* ' if i in row.best else ''}{number(row, i)}"
                    for i in range(len(row.values))
                ),
                _quantity(row.key).unit,
            )
            for row in found.rows
        ],
    )
    if found.parameters:
        print_table(
            "parameters that differ",
            ("parameter", *found.names),
            [(name, *map(setting, values)) for name, values in found.parameters.items()],
        )
    for name, whose in branched(found):
        click.echo(f"{name}: {whose}")
    for name, where in divergences(found):
        click.echo(f"{found.names[0]} (A) and {name} (B): {where}")
