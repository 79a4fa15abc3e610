"""``trunk map``: stability and performance over two parameters, as a picture."""

from __future__ import annotations

from pathlib import Path

import click

from ..errors import PlanError


@click.command("map")
@click.argument("source", metavar="STUDY-or-PARQUET")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The picture: .png, .svg or .pdf.  [default: beside the results, .png]",
)
@click.option("--x", "x", metavar="NAME", help="Grid variable to the right.  [default: the first]")
@click.option("--y", "y", metavar="NAME", help="Grid variable upwards.  [default: the second]")
@click.option(
    "--metric",
    default="steady_state_error_rms_deg",
    show_default=True,
    help="The column that is coloured.",
)
@click.option("--no-floquet", is_flag=True, help="Leave out the line of the Floquet multipliers.")
@click.pass_context
def command(
    ctx: click.Context,
    source: str,
    output: Path | None,
    x: str | None,
    y: str | None,
    metric: str,
    no_floquet: bool,
) -> None:
    """Draw a sweep's results over two of its grid's variables, a panel per controller.

    A study that was not swept yet is swept first, into STUDY.parquet here. Grey: more than half of the
    draws fell. The line of the Floquet multipliers belongs to the loop linearised about the upright
    trunk, the hip driven at its initial speed and no limit on the torque.
    """
    from ..study.map import draw, panels
    from ..study.results import Results
    from ..views.plot_style import SUFFIXES, save

    path = Path(source)
    if path.suffix != ".parquet":
        from .sweep import command as sweep

        path = Path(f"{path.stem}.parquet")
        if path.exists():
            raise PlanError(f"{path} exists: give it in place of {source}, or delete it")
        ctx.invoke(sweep, study=source, output=path, force=False)
    target = output or path.with_suffix(".png")
    if target.suffix.lower() not in SUFFIXES:
        raise click.BadParameter(
            f"{target}: a picture's name ends in one of {', '.join(SUFFIXES)}", param_hint="-o"
        )
    results = Results.read(path)
    if len(results.grid) < 2 and not (x and y):
        raise PlanError(
            f"{path}: a map needs two grid variables; there are: {', '.join(results.grid) or 'none'}"
        )
    axes = x or results.grid[0], y or results.grid[1]
    found = panels(results, metric, axes, not no_floquet)
    save(draw(found, metric, axes, f"{path.stem}: {len(results.table)} runs"), target)
    click.echo(f"{target}: {len(found)} controllers over {axes[0]} and {axes[1]}")
