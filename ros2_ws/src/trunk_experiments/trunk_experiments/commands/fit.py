"""``trunk fit``: parameters from measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_msgs_util.mechanics import MOST_HARMONICS
from trunk_msgs_util.parameters.files import write

from ..console.document import json_option, write_json
from ..console.options import FiniteRange
from ..console.outputs import check_output, output_options
from ..console.tables import print_table
from ..console.verbs import Verbs
from ..results import Keyword, Result


@dataclass(frozen=True)
class FitPathResult(Result, document="fit-path-1"):
    """The document of ``trunk fit path``."""

    output: Annotated[Path | None, "The parameter file; null: none asked for"]
    points: Annotated[int, Keyword("minimum", 3)]
    parameters: Annotated[Mapping[str, object], "The simulator's, SI units"]
    rms_m: Annotated[float, "The points' distance from the path"]
    largest_m: float


@click.group("fit", cls=Verbs)
def command() -> None:
    """Compute parameters from measurements."""


@command.command("path")
@click.argument("points", metavar="GAIT.csv", type=click.Path(path_type=Path))
@click.option(
    "--harmonics",
    type=click.IntRange(1, MOST_HARMONICS),
    default=5,
    show_default=True,
    metavar="N",
    help=f"The highest harmonic, 1 to {MOST_HARMONICS}.",
)
@click.option(
    "--period",
    type=FiniteRange(0.007, 1e6, unit="m"),
    metavar="M",
    help="The path's period.  [default: from the first x to the last]",
)
@output_options("The ROS 2 parameter file to write, for --params or --params-file.")
@json_option(FitPathResult)
def path_command(
    points: Path,
    harmonics: int,
    period: float | None,
    output: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Fit the hip's path to measured points.

    GAIT.csv has x and y of the hip in m, one point per line, over one period or more. The least-squares
    Fourier series becomes path.wavenumber, path.cosines and path.sines, and the same for computed_torque's
    model.
    """
    from ..tuning.gait import fit_path, read_points

    if output is not None:
        check_output(output, (".yaml", ".yml"), force, [points])
    x, y = read_points(points)
    fit = fit_path(x, y, harmonics, period)
    if output is not None:
        write(output, fit.parameters)
    if as_json:
        parameters = fit.parameters["simulator"]
        write_json(FitPathResult(output, len(x), parameters, fit.rms, fit.largest))
        return
    rows = [
        (str(n), f"{a:.6g}", f"{b:.6g}")
        for n, (a, b) in enumerate(zip(fit.cosines, fit.sines, strict=True), 1)
    ]
    print_table(f"path, k = {fit.wavenumber:.6g} rad/m", ("n", "cosine (m)", "sine (m)"), rows)
    click.echo(f"{len(x)} points: {fit.rms:.3g} m from the path (RMS), {fit.largest:.3g} m at most")
    if output is not None:
        click.echo(f"{output}: for --params, or ros2 run … --ros-args --params-file")
