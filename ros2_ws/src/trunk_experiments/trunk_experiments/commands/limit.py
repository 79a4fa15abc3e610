"""``trunk limit``: the greatest value of a parameter that a controller withstands."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.parameters.declarations import (
    UnitError,
    declarations,
    values_of,
)
from trunk_msgs_util.parameters.to_si import number_in, units_of

from ..console.document import json_option, write_json
from ..console.options import names_or_files, studies
from ..console.outputs import check_output, output_options
from ..console.plan_options import ControllerName, parameter_options
from ..console.progress import progress_bar
from ..console.tables import print_table
from ..console.terminal import show_warnings
from ..errors import PlanError
from ..plans.plan import RunPlan, make_plan

if TYPE_CHECKING:
    from ..study.limit import Bracket, Survival


@click.command("limit")
@click.argument("scenario", required=False)
@click.option("--vary", required=True, metavar="NODE.PARAM", help="The parameter, a number.")
@click.option(
    "--from", "low", default="0", show_default=True, help="Its first value; a unit is allowed."
)
@click.option("--to", "high", required=True, help="Its last value, such as 300Nm.")
@click.option(
    "--within",
    type=click.FloatRange(1e-9, 1.0),
    default=1e-3,
    show_default=True,
    help="How exact, as a share of the range.",
)
@click.option(
    "--controller",
    "controllers",
    type=ControllerName(),
    multiple=True,
    help="Repeatable.  [default: pid, fuzzy_pid]",
)
@parameter_options
@click.option(
    "--study",
    metavar="STUDY",
    shell_complete=names_or_files(studies),
    help="In place of SCENARIO: how many of its random runs stand each value.",
)
@click.option(
    "--points",
    type=click.IntRange(2, 1000),
    default=31,
    show_default=True,
    help="With --study: how many values.",
)
@output_options("A folder for the two recordings on either side; with --study, the picture.")
@json_option("limit-1")
def command(
    scenario: str | None,
    vary: str,
    low: str,
    high: str,
    within: float,
    controllers: tuple[str, ...],
    params: tuple[str, ...],
    settings: tuple[str, ...],
    study: str | None,
    points: int,
    output: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Find the greatest value of a parameter with which the trunk of SCENARIO stays up: bisection.

    Up to it every tried value stands. With --study, print the share of its runs that withstand each value,
    with 95 % intervals. A run stands if the trunk stays within 90 degrees.
    """
    if (scenario is None) == (study is None):
        raise PlanError("give a SCENARIO, or --study STUDY")
    if study is not None:
        if controllers or params or settings:
            raise PlanError(
                "--study brings its own controllers and parameters: leave the others out"
            )
        _study(study, vary, low, high, points, output, force, as_json)
        return
    make = partial(_plan, str(scenario), params, settings, vary)
    names = controllers or ("pid", "fuzzy_pid")
    try:
        last = make(names[0], high)
    except TrunkError as error:
        reason = str(error).removeprefix(f"--set {vary}={high}: ")
        raise PlanError(f"--vary {vary} --to {high}: {reason}") from None
    bounds, unit = _range(last, vary, low, high)
    if output is not None:
        if output.exists() and not output.is_dir():
            raise PlanError(f"--output {output}: a file: give a folder for the recordings")
        files = {n: [output / f"{n}_{side}.mcap" for side in ("stands", "falls")] for n in names}
        for path in (path for pair in files.values() for path in pair):
            if path.exists() and not force:
                raise PlanError(f"{path}: it exists: give another folder, or --force")
    limits = _limits(make, names, bounds, within)
    recordings = {}
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        recordings = {n: _record(make, n, limits[n], files[n], force) for n in names}
    if as_json:
        rows = [
            {"controller": n, **limit.as_values(), "recordings": recordings.get(n, [])}
            for n, limit in limits.items()
        ]
        write_json("limit-1", {"parameter": vary, "unit": unit, "limits": rows, "survival": []})
        return
    _show(limits, vary, unit, bounds)
    for path in (path for pair in recordings.values() for path in pair):
        click.echo(f"recording: {path}")


def _plan(
    scenario: str, params: tuple[str, ...], settings: tuple[str, ...], vary: str,
    controller: str, value: str,
) -> RunPlan:  # fmt: skip
    return make_plan(scenario, controller, params, [*settings, f"{vary}={value}"])


def _range(plan: RunPlan, vary: str, low: str, high: str) -> tuple[tuple[float, float], str]:
    """Return the bounds in the parameter's SI unit, and the unit. Raises PlanError."""
    node, _, name = vary.partition(".")
    config = plan.configs.get(node)
    if config is None:
        raise PlanError(f"--vary {vary}: {node} does not run: one of {', '.join(plan.configs)}")
    declared, values = declarations(type(config))[name], values_of(config)
    if declared.kind != "double":
        raise PlanError(
            f"--vary {vary}: it is of the type {declared.kind}: give a single real number"
        )
    units = units_of(declared, values)[0]
    try:
        first, last = number_in(low, units[0]), number_in(high, units[0])
    except UnitError as error:
        raise PlanError(f"--from {low}, --to {high}: {error}") from None
    if not first < last:
        raise PlanError(f"--from {low}, --to {high}: --from must be the smaller one")
    return (first, last), units[0]


def _limits(
    make: Any, names: tuple[str, ...], bounds: tuple[float, float], within: float
) -> dict[str, Bracket]:
    from ..study.limit import find_limit

    limits = {}
    for name in names:
        low, high = bounds
        limits[name] = find_limit(partial(_at, make, name), low, high, within * (high - low))
    return limits


def _at(make: Any, name: str, value: float) -> RunPlan:
    plan: RunPlan = make(name, repr(value))
    return plan


def _record(make: Any, name: str, limit: Bracket, files: list[Path], force: bool) -> list[Path]:
    """Record the runs on either side of a limit, as far as there are any; return the files."""
    from trunk_sim.simulation import DivergedError

    from ..runs.offline_recording import record_offline

    written = []
    for value, path in zip((limit.stands, limit.falls), files, strict=True):
        if value is None:
            continue
        try:
            record_offline(_at(make, name, value), path, overwrite=force)
        except DivergedError:
            show_warnings([f"{path}: diverges, as recorded"])
        written.append(path)
    return written


def _show(limits: dict[str, Bracket], vary: str, unit: str, bounds: tuple[float, float]) -> None:
    rows = []
    for name, limit in limits.items():
        if limit.stands_again:
            again = ", ".join(f"{value:g}" for value in limit.stands_again[:5])
            show_warnings([f"{name}: beyond the first fall it stands again at {again} {unit}"])
        rows.append(
            (
                name,
                "none" if limit.stands is None else f"{limit.stands:.5g}",
                "none" if limit.falls is None else f"{limit.falls:.5g}",
                str(limit.runs),
            )
        )
    low, high = bounds
    print_table(
        f"greatest {vary} from {low:g} to {high:g} {unit}",
        ("controller", f"stands, {unit}", f"falls, {unit}", "runs"),
        rows,
    )


def _study(
    name: str, vary: str, low: str, high: str, points: int, output: Path | None, force: bool,
    as_json: bool,
) -> None:  # fmt: skip
    import numpy as np

    from ..study.bases import make_bases
    from ..study.file import read_study
    from ..study.limit import survival
    from ..study.study import Target

    if output is not None:
        from ..views.plot_style import SUFFIXES

        check_output(output, tuple(SUFFIXES), force, [name])
    study = read_study(name)
    node, _, parameter = vary.partition(".")
    base = next(iter(make_bases(study).values()))
    plan = RunPlan(**{**vars(base.plan), "disturbance": base.disturbance})
    bounds, unit = _range(plan, vary, low, high)
    values = np.linspace(*bounds, points).tolist()
    total = study.total * points
    done = 0
    with progress_bar("runs") as show_done:

        def progress(runs: int) -> None:
            nonlocal done
            done += runs
            show_done(done, total)

        curves = survival(study, Target(node, parameter), values, progress)
    if output is not None:
        from ..study.curves import draw_survival
        from ..views.plot_style import save, with_unit

        title = f"{name}: {next(iter(curves.values())).runs} runs at each value, 95 % intervals"
        save(draw_survival(curves, with_unit(vary, unit), title), output)
    if as_json:
        write_json(
            "limit-1",
            {
                "parameter": vary,
                "unit": unit,
                "limits": [],
                "survival": [_survival_values(n, curve) for n, curve in curves.items()],
            },
        )
        return
    print_table(
        f"runs of {name} that stand, % (95 %: Wilson)",
        (f"{vary}, {unit}", *curves),
        [
            (f"{value:.4g}", *(_share(curve, k) for curve in curves.values()))
            for k, value in enumerate(values)
        ],
    )
    for controller, curve in curves.items():
        half = curve.half()
        at = "not reached" if half is None else f"{half:.4g} {unit}"
        click.echo(f"half of them fall, {controller}: {at}")
    if output is not None:
        click.echo(f"picture: {output}")


def _share(curve: Survival, k: int) -> str:
    estimate = curve.shares[k]
    return f"{100 * estimate.value:.0f} ({100 * estimate.low:.0f} to {100 * estimate.high:.0f})"


def _survival_values(controller: str, curve: Survival) -> dict[str, object]:
    return {
        "controller": controller,
        "runs": curve.runs,
        "half_falls_at": curve.half(),
        "points": [
            {"value": value, "share": estimate.value, "low": estimate.low, "high": estimate.high}
            for value, estimate in zip(curve.values, curve.shares, strict=True)
        ],
    }
