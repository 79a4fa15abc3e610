"""``trunk study map``: stability and performance over one or two parameters, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from ...console.document import json_option, write_json
from ...console.options import results_argument
from ...console.outputs import check_output, output_options
from ...console.progress import progress_bar
from ...errors import PlanError


@click.command("map")
@results_argument
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
    results: Path,
    output: Path | None,
    force: bool,
    x: str | None,
    y: str | None,
    metric: str,
    no_floquet: bool,
    as_json: bool,
) -> None:
    """Draw a sweep's results over two of its grid's variables, one panel per controller; over one, as curves.

    Grey, or a cross: more than half of the draws fell. Floquet multipliers are those of the loop linearised
    about the upright trunk, with the hip driven at its initial speed and no torque limit.
    """
    from ...study.map import MapResult, draw, draw_curves, panels
    from ...study.results import Results
    from ...views.plots import SUFFIXES, save

    target = output or results.with_suffix(".png")
    check_output(target, tuple(SUFFIXES), force, [results], chooses_format=True)
    read = Results.read(results)
    axes = choose_axes(read.grid, x, y, str(results))
    with progress_bar("Floquet multipliers") as tell:
        drawn = panels(read, metric, axes, not no_floquet, tell)
    title = f"{results.stem}: {len(read.table)} runs"
    if len(axes) == 1:
        picture = draw_curves(drawn, metric, axes[0], read.study, title)
    else:
        picture = draw(drawn, metric, axes, read.study, title)
    save(picture, target)
    if as_json:
        x, y = axes[0], axes[1] if len(axes) > 1 else None
        write_json(MapResult(results, target, len(read.table), metric, x, y, drawn))
        return
    click.echo(f"{target}: {len(drawn)} controllers over {' and '.join(axes)}")


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
