"""``trunk compare``: runs side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import click

from trunk_core.results import Keyword, Quantity, Result, number
from trunk_evidence.differences import FirstDifference
from trunk_evidence.doubts import Doubts
from trunk_evidence.parameter_text import ChangedParameter, differing_texts, lines_of, value_text
from trunk_evidence.recorded_run import BranchOf
from trunk_evidence.run_metrics import QUANTITIES
from trunk_views.comparison import Comparison, compare, not_ranked, split_parameters, table_grids

from ..console.document import json_option, write_json
from ..console.reading import open_views, show_warnings_of
from ..console.tables import csv_table, markdown_table, print_table
from ..console.terminal import print_title


class ComparedRun(NamedTuple):
    """A run beside others."""

    name: str
    file: Annotated[Path, "The recording"]
    doubts: Doubts
    branch: Annotated[BranchOf | None, "The run that it is a branch of; null: it is none"]


class ComparedMetric(NamedTuple):
    """A metric of all runs."""

    unit: str
    values: Annotated[Sequence[float | None], "One for each run"]
    best: Annotated[Sequence[str], "Names of runs; a doubtful one never"]


@dataclass(frozen=True)
class CompareResult(Result, document="compare-1"):
    """The document of ``trunk compare RUN...``."""

    runs: Annotated[Sequence[ComparedRun], Keyword("minItems", 1)]
    different_tasks: Annotated[Sequence[str], "In what tasks differ: why runs are not ranked"]
    metrics: Annotated[Mapping[str, ComparedMetric], "By quantity"]
    changed: Annotated[Mapping[str, Sequence[ChangedParameter]], "While it ran, by run and time"]
    parameters: Annotated[
        Mapping[str, Sequence[object]], "That differ: a value for each run, or null"
    ]
    first_divergence: Annotated[
        Mapping[str, FirstDifference | None], "From the first run (a), by name"
    ]


@click.command("compare")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@json_option(CompareResult)
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
    comparison = compare(views)
    if as_json or form is not None:
        show_warnings_of(views)
    if as_json:
        write_json(result_of(comparison, [view.path for view in views]))
    elif form == "csv":
        click.echo(as_csv(comparison), nl=False)
    elif form == "markdown":
        click.echo(as_markdown(comparison))
    else:
        for line in doubtful(comparison):
            click.echo(line)
        show_warnings_of(views)
        _show(comparison)


def divergences(comparison: Comparison) -> list[tuple[str, str]]:
    """Return, for each run after the first, its name and where it diverges from the first."""
    return [
        (name, d.describe()) for name, d in zip(comparison.names[1:], comparison.diffs, strict=True)
    ]


def result_of(comparison: Comparison, files: Sequence[Path]) -> CompareResult:
    """Return the document of a comparison of the runs in some files."""
    names, diffs = comparison.names, comparison.diffs
    runs = zip(names, files, comparison.doubts, comparison.branches, strict=True)
    return CompareResult(
        tuple(ComparedRun(*run) for run in runs),
        comparison.tasks,
        {
            row.key: ComparedMetric(
                _quantity(row.key, comparison.words).unit, row.values, [names[i] for i in row.best]
            )
            for row in comparison.rows
        },
        dict(zip(names, comparison.changed, strict=True)),
        comparison.parameters,
        {name: diff.first for name, diff in zip(names[1:], diffs, strict=True)},
    )


def as_csv(comparison: Comparison) -> str:
    """Return the metrics as CSV in full precision; empty if a quantity does not exist."""
    rows = [
        (
            row.key,
            _quantity(row.key, comparison.words).unit,
            *row.values,
            "; ".join(comparison.names[i] for i in row.best),
        )
        for row in comparison.rows
    ]
    return csv_table(("quantity", "unit", *comparison.names, "best"), rows)


def as_markdown(comparison: Comparison) -> str:
    """Return the metrics, the best in bold, and the differing parameters as Markdown tables."""
    names = comparison.names
    lines = [f"- **{line}**" for line in doubtful(comparison)]
    lines += [""] if lines else []
    rows = []
    for row in comparison.rows:
        numbers = map(number, row.values)
        shown = [f"**{text}**" if i in row.best else text for i, text in enumerate(numbers)]
        quantity = _quantity(row.key, comparison.words)
        rows.append((quantity.label, quantity.unit, *shown))
    lines += [markdown_table(("quantity", "unit", *names), rows)]
    beside, only = settings(comparison)
    if beside:
        lines += ["", markdown_table(("parameter", *names), beside)]
    for whose, values in only.items():
        lines += ["", f"Only in {whose}:", "", markdown_table(("parameter", "value"), values)]
    if lines_of_changes := changed(comparison):
        lines += ["", *(f"- {line}" for line in lines_of_changes)]
    for title, (head, *cells) in table_grids(
        comparison.names, comparison.parameters, comparison.axes
    ):
        lines += ["", f"{title}:", "", markdown_table(head, cells)]
    notes = [*branched(comparison), *divergences(comparison)]
    lines += ["", *(f"- {name}: {where}" for name, where in notes)]
    return "\n".join(lines).rstrip()


def branched(comparison: Comparison) -> list[tuple[str, str]]:
    """Return the name of each run that is a branch, and of which run it is one."""
    return [
        (name, branch.describe())
        for name, branch in zip(comparison.names, comparison.branches, strict=True)
        if branch is not None
    ]


def _quantity(key: str, words: Callable[[str], str]) -> Quantity:
    return QUANTITIES[key].said(words) if key in QUANTITIES else Quantity(key, "")


def settings(
    comparison: Comparison,
) -> tuple[list[tuple[str, ...]], dict[str, list[tuple[str, str]]]]:
    """Return the rows of the table of differing parameters, and those that only some runs have."""
    beside, only = split_parameters(comparison.names, comparison.parameters)
    rows = [
        (name, *differing_texts(values, comparison.axes.get(name)))
        for name, values in beside.items()
    ]
    return rows, {
        whose: [(name, value_text(value)) for name, value in values.items()]
        for whose, values in only.items()
    }


def changed(comparison: Comparison) -> list[str]:
    """Return a line for each parameter that was changed while a run went on."""
    return [
        f"{name}: {line}"
        for name, changes in zip(comparison.names, comparison.changed, strict=True)
        for line in lines_of(changes)
    ]


def doubtful(comparison: Comparison) -> list[str]:
    """Return a line for each doubt about a run, and one if the runs are not ranked."""
    lines = [
        f"{name}: {line}"
        for name, doubts in zip(comparison.names, comparison.doubts, strict=True)
        for line in doubts.lines
    ]
    return [*filter(None, [not_ranked(comparison.tasks)]), *lines]


def _show(comparison: Comparison) -> None:
    legend = "* best; doubtful runs are not ranked" if any(comparison.doubts) else "* best"
    print_table(
        f"metrics ({'not ranked' if comparison.tasks else legend})",
        ("quantity", *comparison.names, "unit"),
        [
            (
                _quantity(row.key, comparison.words).label,
                *(f"{'* ' * (i in row.best)}{number(v)}" for i, v in enumerate(row.values)),
                _quantity(row.key, comparison.words).terminal_unit,
            )
            for row in comparison.rows
        ],
    )
    beside, only = settings(comparison)
    if beside:
        print_table("parameters that differ", ("parameter", *comparison.names), beside)
    for title, (head, *cells) in table_grids(
        comparison.names, comparison.parameters, comparison.axes
    ):
        print_table(title, head, cells)
    for whose, values in only.items():
        print_table(f"parameters only in {whose}", ("parameter", "value"), values)
    if lines := changed(comparison):
        print_title("changed while it ran")
        click.echo("\n".join([*lines, ""]))
    for name, whose in branched(comparison):
        click.echo(f"{name}: {whose}")
    if comparison.diffs:
        print_title("first difference")
    for name, where in divergences(comparison):
        click.echo(f"{comparison.names[0]} (A) and {name} (B): {where}")
