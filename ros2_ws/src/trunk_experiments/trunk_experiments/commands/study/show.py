"""``trunk study show``: one run of a sweep again, as a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import click

from ...analysis.metrics import Metrics
from ...console.document import json_option, write_json
from ...console.options import WholeRange, results_argument
from ...console.outputs import check_output, output_options
from ...console.reading import WrittenResult, about_written
from ...console.terminal import line_of
from ...errors import PlanError
from ...results import Count

_LONG = 100_000  # states, which take seconds


@dataclass(frozen=True)
class StudyShowResult(WrittenResult, document="study-show-1"):
    """The document of ``trunk study show``."""

    study: Annotated[Path, "The sweep's file"]
    run: Count
    controller: str
    point: Annotated[Count, "Of the grid"]
    draw: Count
    varied: Annotated[Mapping[str, float | str | bool], "The study's entries in this run, by name"]
    status: Literal["ok", "diverged"]
    failure: Annotated[str | None, "Where the plant diverged; null: it did not"]
    metrics: Annotated[Metrics | None, "Those of the row, bit by bit; null: it diverged"]
    report: Annotated[Path | None, "The report on the run; null: not asked for"]


@click.command("show")
@results_argument
@click.option(
    "--run",
    "number",
    required=True,
    type=WholeRange(0, 2**63 - 1),
    metavar="N",
    help="The run's number, from the column run of the results.",
)
@output_options("The MCAP file to write.", required=True)
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    metavar="FILE.html",
    help="Also write a report on the run.",
)
@json_option(StudyShowResult)
def command(
    results: Path,
    number: int,
    output: Path,
    force: bool,
    report: Path | None,
    as_json: bool,
) -> None:
    """Run one of a sweep's runs again, offline, as a recording that verifies.

    Its metrics equal its row bit for bit; otherwise nothing is written, and the error says what differs.
    """
    from ...console.progress import progress_bar
    from ...study.results import METRICS, Results, record_again, study_run

    check_output(output, (".mcap",), force, [results])
    if report is not None:
        check_output(report, (".html", ".htm"), force, [results], "--report")
        if report.resolve() == output.resolve():
            raise PlanError(f"--report {report}: it is also the output: give another name")
    run = study_run(Results.read(results), number)
    with progress_bar(f"simulating run {number}", _LONG) as tell:
        diverged = record_again(run, output, force, tell)
    size = None if report is None else _write_report(output, report)
    written = about_written(output)
    controller = str(run.row["controller"])
    if as_json:
        result = StudyShowResult(
            **vars(written),
            study=results,
            run=number,
            controller=controller,
            point=run.row["point"],
            draw=run.row["draw"],
            varied=run.varied,
            status=run.row["status"],
            failure=None if diverged is None else line_of(diverged),
            metrics=None if diverged else Metrics(**{name: run.row[name] for name in METRICS}),
            report=report,
        )
        write_json(result)
        return
    if diverged is not None:
        click.echo(f"diverged, as in the sweep: {line_of(diverged)}")
    elif run.fell:
        click.echo("fell, as in the sweep")
    from ...study.study import shown

    study = run.results.study
    drawn = ", ".join(f"{name} {shown(study, name, value)}" for name, value in run.varied.items())
    click.echo(f"{output}: run {number}, {controller}, {written.states} states; {drawn}")
    if diverged is None:
        click.echo(f"{output}: the metrics equal the row in {results}, bit for bit")
    if size is not None:
        click.echo(f"{report}: 1 run, {size / 1e6:.1f} MB")


def _write_report(recording: Path, target: Path) -> int:
    from ...console.reading import open_views, show_warnings_of
    from ...views.report import make_report, write

    views = open_views([recording])
    show_warnings_of(views)
    return write(make_report(views), target)
