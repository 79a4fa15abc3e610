"""``trunk report``: runs as one HTML page."""

from __future__ import annotations

from pathlib import Path

import click

from ..console.reading import open_views


@click.command("report")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The page to write; default RUN.html.",
)
def command(runs: tuple[Path, ...], output: Path | None) -> None:
    """Write one HTML file that shows recorded runs: animated, plotted, judged.

    It needs no network and no server; several runs stand side by side on the same clock.
    """
    from ..views.report import make_report
    from ..views.report_page import write

    target = output or Path(f"{runs[0].stem}.html")
    views = open_views(runs)
    size = write(make_report(views), target)
    click.echo(f"{target}: {len(views)} run{'s' if len(views) > 1 else ''}, {size / 1e6:.1f} MB")
