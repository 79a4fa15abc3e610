"""``trunk plot``: runs as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_core.results import Keyword
from trunk_evidence.doubts import RecordingResult, about, doubts_of

from ..console.document import json_option, write_json
from ..console.options import OutputResult, WholeRange, check_output, default_name, output_options
from ..console.reading import open_views, show_warnings_of
from ..console.terminal import show_warnings


@dataclass(frozen=True)
class PlotResult(OutputResult, document="plot-1"):
    """The document of ``trunk plot``."""

    runs: Annotated[Sequence[RecordingResult], Keyword("minItems", 1)]


@click.command("plot")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
@output_options(
    "The picture: .png, .svg or .pdf.  [default: RUN.png, named after the run's folder; figN.png with --fig]"
)
@click.option(
    "--fig",
    "number",
    type=WholeRange(6, 9),
    help="Lay it out like the paper's figure: only the angles, in one plot.",
)
@click.option(
    "--memberships",
    "rules",
    flag_value="memberships",
    help="Draw the triangles of the rules' inputs, and the run's way through them; of one run.",
)
@click.option(
    "--surface",
    "rules",
    flag_value="surface",
    help="Draw what the rules infer over e and ė, and the run's way over it; of one run.",
)
@json_option(PlotResult)
def command(
    runs: tuple[Path, ...],
    output: Path | None,
    force: bool,
    number: int | None,
    rules: str | None,
    as_json: bool,
) -> None:
    """Draw one recorded run, or several overlaid, as PNG, SVG or PDF."""
    if rules and (number or len(runs) > 1):
        raise click.UsageError(f"--{rules}: give one run, and no --fig")
    from trunk_views.plots import SUFFIXES, overview, paper_figure, save

    default = Path(f"fig{number}.png") if number else default_name(runs[0], ".png")
    default = default.with_stem(f"{default.stem}_{rules}") if rules else default
    target = check_output(output or default, tuple(SUFFIXES), force, runs, chooses_format=True)
    views = open_views(runs)
    doubts = [doubts_of(view.run, twin=False) for view in views]
    for view, run_doubts in zip(views, doubts, strict=True):
        show_warnings(f"{view.path}: {line}" for line in run_doubts.lines)
        scenario = view.recording.provenance.get("scenario")
        if number and scenario != f"fig{number}":
            show_warnings([f"{view.path}: its scenario is {scenario!r}, not 'fig{number}'"])
    show_warnings_of(views)
    if rules:
        from trunk_views import rule_plots

        figure = (rule_plots.surface if rules == "surface" else rule_plots.memberships)(views[0])
    else:
        figure = paper_figure(views, number) if number else overview(views)
    save(figure, target)
    if as_json:
        runs_shown = [about(view.run, known) for view, known in zip(views, doubts, strict=True)]
        write_json(PlotResult(target, runs_shown))
        return
    click.echo(f"{target}: {len(views)} run{'s' if len(views) > 1 else ''}")
