"""``trunk study report``: a sweep's results as one HTML page."""

from __future__ import annotations

from pathlib import Path

import click

from ...console.document import json_option, write_json
from ...console.options import results_argument
from ...console.outputs import check_output, output_options


@click.command("report")
@results_argument
@output_options("The page to write.  [default: beside the results, .html]")
@click.option(
    "--metric",
    default="iae",
    show_default=True,
    help="The metric that picks the worst runs, and that the map shows.",
)
@click.option(
    "--no-floquet", is_flag=True, help="Leave out the map's line of the Floquet multipliers."
)
@json_option("study.report:StudyReportResult")
def command(
    results: Path,
    output: Path | None,
    force: bool,
    metric: str,
    no_floquet: bool,
    as_json: bool,
) -> None:
    """Write one HTML file on a sweep: falls, map, distributions, differences, the worst ten runs.

    It needs no network and runs no script. Each of the worst runs comes with the command that repeats it.
    """
    from trunk_msgs_util.files import atomic_write

    from ...console.progress import progress_bar
    from ...study.report import StudyReportResult, make_report, render
    from ...study.results import Results

    target = output or results.with_suffix(".html")
    check_output(target, (".html", ".htm"), force, [results])
    read = Results.read(results)
    with progress_bar("Floquet multipliers") as tell:
        report = make_report(read, metric, None if no_floquet else tell)
    page = render(report).encode("utf-8")
    with atomic_write(target) as part:
        part.write_bytes(page)
    if as_json:
        write_json(StudyReportResult(results, target, len(page), report.runs, report.worst))
        return
    click.echo(f"{target}: {report.runs} runs, {len(page) / 1e6:.1f} MB")
