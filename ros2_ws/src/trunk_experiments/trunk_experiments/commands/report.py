"""``trunk report``: runs as one HTML page, written and opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_core.results import Count, Keyword
from trunk_evidence.doubts import RecordingResult, about

from ..console.document import json_option, write_json
from ..console.options import OutputResult, check_output, default_name, output_options
from ..console.reading import open_views, show_warnings_of
from ..console.terminal import open_page, show_warnings


@dataclass(frozen=True)
class ReportResult(OutputResult, document="report-1"):
    """The document of ``trunk report``."""

    bytes: Count
    runs: Annotated[Sequence[RecordingResult], Keyword("minItems", 1)]


@click.command("report")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@output_options("The page to write.  [default: RUN.html, named after the run's folder]")
@click.option(
    "--open", "opens", is_flag=True, help="Open the page in a browser, where there is one."
)
@json_option(ReportResult)
def command(
    runs: tuple[Path, ...],
    output: Path | None,
    force: bool,
    opens: bool,
    as_json: bool,
) -> None:
    """Write one HTML file that shows recorded runs: animated, plotted, judged.

    It needs no network and no server; several runs are shown side by side on the same clock.
    """
    from trunk_views.run_report import make_report, write

    target = check_output(output or default_name(runs[0], ".html"), (".html", ".htm"), force, runs)
    views = open_views(runs)
    show_warnings_of(views)
    size = write(make_report(views), target)
    if as_json:
        write_json(ReportResult(target, size, [about(view.run) for view in views]))
    else:
        click.echo(
            f"{target}: {len(views)} run{'s' if len(views) > 1 else ''}, {size / 1e6:.1f} MB"
        )
    page = target.absolute().as_uri()
    if opens and not open_page(page):
        show_warnings([f"--open: there is no browser here: open {page}"])
