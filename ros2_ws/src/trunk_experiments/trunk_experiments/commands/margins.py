"""``trunk margins``: how far given gains are from instability, as numbers and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from trunk_core.errors import PlanError
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.plan import RunPlan

from ..console.document import json_option, write_json
from ..console.options import ControllerName, check_output, loop_options, loop_plan, output_options
from ..console.tables import print_table
from ..console.terminal import show_warnings

if TYPE_CHECKING:
    from trunk_studies.tuning.stability_margins import LoopMargins


@click.command("margins")
@click.argument("run", required=False, type=click.Path(path_type=Path))
@click.option(
    "--controller", type=ControllerName(), help="Without a RUN: the controller.  [default: pid]"
)
@loop_options
@output_options("Also a picture: Bode, Nyquist, root locus and step; .png, .svg or .pdf.")
@json_option("trunk_studies.tuning.stability_margins:MarginsResult")
def command(
    run: Path | None,
    controller: str | None,
    params: tuple[str, ...],
    settings: tuple[str, ...],
    rate: float | None,
    output: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Print the margins of the loop about the upright: of a recorded RUN, or of parameters.

    The loop is linearised with delays, filters and drive, its hip prescribed and passive on level ground. The
    profile is profile_practical unless --params gives another. docs/tuning.md says what each column means,
    and which margins are thin.
    """
    from trunk_studies.tuning.stability_margins import MarginsResult, plan_margins

    if str(run) in CONTROLLERS and not Path(str(run)).exists():
        raise PlanError(f"{run} is a controller: give --controller {run}")
    if output is not None:
        from trunk_views.plots import SUFFIXES

        check_output(output, tuple(SUFFIXES), force, [run] if run else list(params))
    if run is None:
        plan = loop_plan(controller or "pid", params, settings, rate)
    elif controller or params or settings or rate:
        raise PlanError(
            f"{run} brings its own parameters: give a RUN, or --controller and --params"
        )
    else:
        from trunk_evidence.recorded_run import RecordedRun

        plan = RecordedRun.open(run).plan()
    show_warnings(plan.warnings)
    rows = plan_margins(plan)
    if output is not None:
        from trunk_studies.tuning.stability_margins import draw
        from trunk_views.plots import save

        rate_text = f"{plan.controller.update_rate:g} Hz"
        drawn = [row for row in rows if row.at in plan.controllers]
        save(
            draw(
                drawn,
                f"{plan.turns} at {rate_text}, about the upright",
                plan.simulator.kind.of_drive,
            ),
            output,
        )
    if as_json:
        show_warnings(margin_warnings(plan, rows))
        write_json(MarginsResult(run, output, plan.controller.update_rate, rows))
        return
    print_margins(plan, rows)
    if output is not None:
        click.echo(f"picture: {output}")


def margin_warnings(plan: RunPlan, rows: Sequence[LoopMargins]) -> list[str]:
    """Return the reasons to doubt margins: thin ones, a model of another plant, what is left out.

    Of a plant without a prescribed row also which controllers leave the first coordinate to itself.
    """
    from trunk_runs.plan import does_not_hold
    from trunk_studies.tuning.linear import left_out
    from trunk_studies.tuning.stability_margins import other_plants, weakness

    kind = plan.simulator.kind
    first = kind.coordinates[0].joint
    alone = [
        does_not_hold(row.at, kind) for row in rows if kind.held is None and row.loop.held == 0
    ]
    weak = ((row, weakness(row)) for row in rows)
    return [
        *other_plants(plan),
        *(f"{row.at}, {first} {row.hip}: {text}" for row, text in weak if text),
        *(line for line in alone if line not in plan.warnings),
        *left_out(plan.simulator),
    ]


def print_margins(plan: RunPlan, rows: Sequence[LoopMargins]) -> None:
    """Print margins as a table, after what makes them doubtful."""
    show_warnings(margin_warnings(plan, rows))
    kind = plan.simulator.kind
    cells = []
    for row in rows:
        m = row.margins
        if m is None:
            numbers = ("UNSTABLE", "", "", "")
        else:
            numbers = (
                f"{m.gain_down:.3g} to {m.gain_up:.3g}",
                f"{m.phase_deg:.1f}",
                f"{m.modulus:.3f}",
                f"{1e3 * m.delay:.4g}",
            )
        cells.append((row.at, row.hip, *numbers, f"{row.spectral_radius:.6f}"))
    print_table(
        f"margins of the sampled loop at {plan.controller.update_rate:g} Hz, linearised {kind.label.lower()}",
        (
            "at",
            kind.coordinates[0].joint,
            "gain, factor",
            "phase °",
            "modulus",
            "delay ms",
            "radius",
        ),
        cells,
    )
