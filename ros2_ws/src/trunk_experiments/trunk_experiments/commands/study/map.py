"""``trunk study map``: stability and performance over one or two parameters, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ...console.document import json_option, write_json
from ...console.options import names_or_files, studies
from ...console.outputs import check_output, output_options
from ...console.progress import progress_bar
from ...errors import PlanError
from .sweep import ended, run_sweep

if TYPE_CHECKING:
    pass


@click.command("map")
@click.argument("source", metavar="STUDY-or-PARQUET", shell_complete=names_or_files(studies))
@output_options("The picture: .png, .svg or .pdf.  [default: beside the results, .png]")
@click.option(
    "--x", "x", metavar="NAME", help="Grid variable on the horizontal axis.  [default: the first]"
)
@click.option(
    "--y",
    "y",
    metavar="NAME",
    help="Grid variable on the vertical axis.  [default: the second, if any]",
)
@click.option(
    "--metric",
    default="steady_state_error_rms_deg",
    show_default=True,
    help="The column to show as colour.",
)
@click.option("--no-floquet", is_flag=True, help="Leave out the line of the Floquet multipliers.")
@json_option("study.map:MapResult")
def command(
    source: str,
    output: Path | None,
    force: bool,
    x: str | None,
    y: str | None,
    metric: str,
    no_floquet: bool,
    as_json: bool,
) -> None:
    """Draw a sweep's results over two of its grid's variables, one panel per controller; over one, as curves.

    A study that has not been swept is swept first, into STUDY.parquet in the current folder. Grey, or a
    cross: more than half of the draws fell. Floquet multipliers are those of the loop linearised about the
    upright trunk, with the hip driven at its initial speed and no torque limit.
    """
    from ...study.map import MapResult, draw, draw_curves, panels
    from ...study.results import Results
    from ...views.plots import SUFFIXES, save

    path = Path(source)
    swept = path.suffix == ".parquet"
    if not swept:
        path = Path(f"{path.stem}.parquet")
    target = output or path.with_suffix(".png")
    check_output(target, tuple(SUFFIXES), force, [source], chooses_format=True)
    if not swept:
        click.echo(_sweep(source, path, (x, y), metric), err=as_json)
    results = Results.read(path)
    axes = choose_axes(results.grid, x, y, str(path))
    with progress_bar("Floquet multipliers") as tell:
        drawn = panels(results, metric, axes, not no_floquet, tell)
    title = f"{path.stem}: {len(results.table)} runs"
    if len(axes) == 1:
        picture = draw_curves(drawn, metric, axes[0], results.study, title)
    else:
        picture = draw(drawn, metric, axes, results.study, title)
    save(picture, target)
    if as_json:
        x, y = axes[0], axes[1] if len(axes) > 1 else None
        write_json(MapResult(path, target, len(results.table), metric, x, y, drawn))
        return
    click.echo(f"{target}: {len(drawn)} controllers over {' and '.join(axes)}")


def _sweep(source: str, path: Path, wanted: tuple[str | None, str | None], metric: str) -> str:
    """Sweep a study into a file; return a line on how its runs ended.

    Raises PlanError before the first run if it cannot give a map.
    """
    from ...study.map import check_mappable
    from ...study.study import read_study
    from ...study.sweep import SweepJob

    if path.exists():
        raise PlanError(f"{path}: it exists: give it in place of {source}, or delete it")
    study = read_study(source)
    check_mappable(study, choose_axes([v.name for v in study.grid], *wanted, source), metric)
    sweep = SweepJob(study, path)
    return ended(sweep, run_sweep(sweep))


def choose_axes(grid: Sequence[str], x: str | None, y: str | None, source: str) -> tuple[str, ...]:
    """Return the horizontal and, if there are two, the vertical grid variable; by default the first two.

    Raises PlanError if there is none.
    """
    known = ", ".join(grid) or "none"
    for name in (x, y):
        if name is not None and name not in grid:
            raise PlanError(f"{source}: {name!r} is not a grid variable; available: {known}")
    if x is not None and x == y:
        raise PlanError(f"{source}: --x and --y are both {x!r}: give two of {known}")
    if not grid:
        raise PlanError(
            f"{source}: a map needs one or two grid variables; it has none: trunk study report "
            "shows the metrics over what is drawn"
        )
    if len(grid) == 1:
        if y is not None:
            raise PlanError(f"{source}: --y {y}: there is no other grid variable: give --x {y}")
        return (grid[0],)
    right = x or next(name for name in grid if name != y)
    return right, y or next(name for name in grid if name != right)
