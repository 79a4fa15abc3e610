"""``trunk plot``: runs as a picture."""

from __future__ import annotations

from pathlib import Path

import click

from ..console.reading import open_views, show_warnings


@click.command("plot")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The picture: .png, .svg or .pdf; default RUN.png, or figN.png with --fig.",
)
@click.option(
    "--fig",
    "number",
    type=click.IntRange(6, 9),
    help="Lay it out like the paper's figure: only the angles, in one axes.",
)
def command(runs: tuple[Path, ...], output: Path | None, number: int | None) -> None:
    """Draw one recorded run, or several overlaid, as PNG, SVG or PDF."""
    from ..views.plot_style import SUFFIXES, save
    from ..views.plots import overview, paper_figure

    target = output or Path(f"fig{number}.png" if number else f"{runs[0].stem}.png")
    if target.suffix.lower() not in SUFFIXES:
        raise click.BadParameter(
            f"{target}: a picture's name ends in one of {', '.join(SUFFIXES)}", param_hint="-o"
        )
    views = open_views(runs)
    for view in views:
        scenario = view.recording.provenance.get("scenario")
        if number and scenario != f"fig{number}":
            show_warnings([f"{view.path}: its scenario is {scenario!r}, not 'fig{number}'"])
    save(paper_figure(views, number) if number else overview(views), target)
    click.echo(f"{target}: {len(views)} run{'s' if len(views) > 1 else ''}")
