"""``trunk report``: runs as one HTML page."""

from __future__ import annotations

from pathlib import Path

import click

from ..console.document import json_option, write_json
from ..console.outputs import check_output, default_name, output_options
from ..console.reading import open_views, run_values, show_warnings_of


@click.command("report")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@output_options("The page to write.  [default: RUN.html, named after the run's folder]")
@json_option("report-1")
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
        documents = [run_values(view.run) for view in views]
        write_json("report-1", {"output": target, "bytes": size, "runs": documents})
        return
    click.echo(f"{target}: {len(views)} run{'s' if len(views) > 1 else ''}, {size / 1e6:.1f} MB")
