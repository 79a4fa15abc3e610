"""``trunk report``: runs as one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from ..console.document import json_option, write_json
from ..console.outputs import OutputResult, check_output, default_name, output_options
from ..console.reading import open_views, show_warnings_of
from ..replay.doubts import RecordingResult, about
from ..results import Count, Keyword


@dataclass(frozen=True)
class ReportResult(OutputResult, document="report-1"):
    """The document of ``trunk report``."""

    bytes: Count
    runs: Annotated[Sequence[RecordingResult], Keyword("minItems", 1)]


@click.command("report")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@output_options("The page to write.  [default: RUN.html, named after the run's folder]")
@json_option(ReportResult)
def command(runs: tuple[Path, ...], output: Path | None, force: bool, as_json: bool) -> None:
    """Write one HTML file that shows recorded runs: animated, plotted, judged.

    It needs no network and no server; several runs are shown side by side on the same clock.
    """
    from ..views.report import make_report
    from ..views.report_page import write

    target = check_output(output or default_name(runs[0], ".html"), (".html", ".htm"), force, runs)
    views = open_views(runs)
    show_warnings_of(views)
    size = write(make_report(views), target)
    if as_json:
        write_json(ReportResult(target, size, [about(view.run) for view in views]))
        return
    click.echo(f"{target}: {len(views)} run{'s' if len(views) > 1 else ''}, {size / 1e6:.1f} MB")
