"""``trunk limit``: how far a parameter, or a push, may go until the trunk falls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import degrees, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trunk_core.errors import PlanError, TrunkError
from trunk_core.parameters.declarations import (
    UnitError,
    declarations,
    index_in,
    table_of,
    values_of,
)
from trunk_core.parameters.to_si import number_in, units_of
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.timeline import parse_push, valued

from ..console.document import json_option, write_json
from ..console.options import (
    ControllerName,
    FiniteRange,
    WholeRange,
    check_output,
    device_option,
    exclude,
    output_options,
    parameter_options,
    studies,
)
from ..console.tables import print_table
from ..console.terminal import progress_bar, show_warnings

if TYPE_CHECKING:
    from trunk_studies.robustness import Limit, SurvivalPoint

PlanOf = Callable[[str, str], RunPlan]  # of a controller, with a value


@click.command("limit")
@click.argument("scenario", required=False)
@click.option("--vary", metavar="NODE.PARAM", help="The parameter, a number.")
@click.option(
    "--push",
    metavar="[CHANNEL=]DURATION[@TIME]",
    help="In place of --vary: the value of one push besides the scenario's disturbances, such as 0.1s@3.",
)
@click.option(
    "--from",
    "low",
    default="0",
    show_default=True,
    help="Its first value, which should stand; a unit is allowed.",
)
@click.option(
    "--to", "high", required=True, help="Its last value, such as 300Nm; it may be the smaller one."
)
@click.option(
    "--within",
    type=FiniteRange(1e-9, 1.0),
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
    shell_complete=studies,
    help="In place of SCENARIO: how many of its random runs stand each value.",
)
@click.option(
    "--points",
    type=WholeRange(2, 1000),
    default=31,
    show_default=True,
    help="With --study: how many values.",
)
@device_option
@output_options(
    "A folder for the two recordings on either side; with --study, the picture.",
    force="Replace files that exist.",
)
@json_option("trunk_studies.robustness:LimitResult")
def command(
    scenario: str | None,
    vary: str | None,
    push: str | None,
    low: str,
    high: str,
    within: float,
    controllers: tuple[str, ...],
    params: tuple[str, ...],
    settings: tuple[str, ...],
    study: str | None,
    points: int,
    device: str,
    output: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Find how far a parameter, or a push, may go with the trunk of SCENARIO upright: bisection.

    From --from up to the limit every tried value stands: the trunk stays within simulator.fall.angle for the
    whole run. With --study, print the share of its runs that stand each value, with 95 % intervals.
    """
    if (scenario is None) == (study is None):
        raise PlanError("give a SCENARIO, or --study STUDY")
    if (vary is None) == (push is None):
        raise PlanError("give --vary NODE.PARAM, or --push [CHANNEL=]DURATION[@TIME]")
    if study is not None:
        own = "controllers", "params", "settings"
        exclude("--study has its own controllers and parameters", *own)
        if vary is None:
            raise PlanError(f"--push {push}: with --study, give --vary disturbance.pulse.magnitude")
        _study(study, vary, low, high, points, device, output, force, as_json)
        return
    if device != "cpu":
        raise PlanError(f"--device {device}: it is for --study alone: leave it out")
    from trunk_studies.robustness import LimitResult, condition_lines, conditions_of

    make = partial(_plan, str(scenario), params, settings, vary, push)
    names = controllers or ("pid", "fuzzy_pid")
    last, first = (_end(make, names[0], vary, *end) for end in (("--to", high), ("--from", low)))
    plant = last.simulator.kind
    pushed = None if push is None else parse_push(valued(push, low), 0.0, plant)
    title = vary or "push"
    others = first if last.disturbance is None else last
    if pushed is not None:
        bounds, unit = _numbers(low, high, plant.channel_units[pushed.channel])
        others = make_plan(str(scenario), names[0], params, settings)
    else:
        bounds, unit = _range({**first.configs, **last.configs}, title, low, high)
    conditions = conditions_of(others, {title}, pushed)
    if output is not None:
        if output.exists() and not output.is_dir():
            raise PlanError(f"--output {output}: a file: give a folder for the recordings")
        files = {n: [output / f"{n}_{side}.mcap" for side in ("stands", "falls")] for n in names}
        for path in (path for pair in files.values() for path in pair):
            if path.exists() and not force:
                raise PlanError(f"{path}: it exists: give another folder, or --force")
    limits = _limits(make, names, bounds, within)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        limits = {n: _record(make, limit, files[n], force) for n, limit in limits.items()}
    if as_json:
        write_json(LimitResult(title, unit, *conditions, [*limits.values()], []))
        return
    _show(limits, title, unit, bounds)
    click.echo("\n".join(condition_lines(conditions, plant)))
    for path in (path for limit in limits.values() for path in limit.recordings):
        click.echo(f"recording: {path}")


def _plan(
    scenario: str, params: tuple[str, ...], settings: tuple[str, ...], vary: str | None,
    push: str | None, controller: str, value: str,
) -> RunPlan:  # fmt: skip
    if push is not None:
        return make_plan(scenario, controller, params, settings, pushes=[valued(push, value)])
    return make_plan(scenario, controller, params, [*settings, f"{vary}={value}"])


def _end(make: PlanOf, controller: str, vary: str | None, option: str, value: str) -> RunPlan:
    """Return the plan at an end of the range. Raises PlanError that names the option."""
    try:
        return make(controller, value)
    except TrunkError as error:
        if vary is None:
            raise
        reason = str(error).removeprefix(f"--set {vary}={value}: ")
        raise PlanError(f"--vary {vary} {option} {value}: {reason}") from None


def _range(
    configs: Mapping[str, Any], vary: str, low: str, high: str
) -> tuple[tuple[float, float], str]:
    """Return the bounds in the parameter's SI unit, and the unit. Raises PlanError."""
    node, _, name = vary.partition(".")
    config = configs.get(node)
    if config is None:
        reason = f"{node} does not run: one of {', '.join(configs)}"
        if node == "disturbance":
            reason = "nothing disturbs at either end: set the others, such as pulse.start_times"
        raise PlanError(f"--vary {vary}: {reason}")
    known, values = declarations(type(config)), values_of(config)
    declared, index = known[table_of(name, known) or name], 0
    if declared.kind == "double array" and name.endswith("]"):
        index = index_in(name, low, values[declared.name])  # type: ignore[arg-type]
    elif declared.kind != "double":
        raise PlanError(
            f"--vary {vary}: it is of the type {declared.kind}: give a single real number, such as "
            f"{vary}[0] of an array"
        )
    units = units_of(declared, values)
    return _numbers(low, high, units[min(index, len(units) - 1)][0])


def _numbers(low: str, high: str, unit: str) -> tuple[tuple[float, float], str]:
    """Return both ends in a unit, and the unit. Raises PlanError."""
    try:
        first, last = number_in(low, unit), number_in(high, unit)
    except UnitError as error:
        raise PlanError(f"--from {low}, --to {high}: {error}") from None
    if not (isfinite(first) and isfinite(last) and first != last):
        raise PlanError(f"--from {low}, --to {high}: two different finite values are needed")
    return (first, last), unit


def _limits(
    make: PlanOf, names: tuple[str, ...], bounds: tuple[float, float], within: float
) -> dict[str, Limit]:
    from trunk_studies.robustness import find_limit, most_runs

    first, last = bounds
    exact = within * abs(last - first)
    most = most_runs(first, last, exact)
    limits: dict[str, Limit] = {}
    with progress_bar("runs") as tell:
        tell(0, most * len(names))
        for name in names:
            before = most * len(limits)

            def plan_at(value: float, name: str = name) -> RunPlan:
                return make(name, repr(value))

            def progress(runs: int, before: int = before) -> None:
                tell(before + runs, most * len(names))

            limits[name] = find_limit(plan_at, first, last, exact, progress)
            progress(most)
    return limits


def _record(make: PlanOf, limit: Limit, files: list[Path], force: bool) -> Limit:
    """Record the runs on either side of a limit, as far as there are any; return it with the files."""
    from trunk_runs.offline_recording import record_offline
    from trunk_sim.simulation import DivergedError

    written = []
    for value, path in zip((limit.stands, limit.falls), files, strict=True):
        if value is None:
            continue
        try:
            record_offline(make(limit.controller, repr(value)), path, overwrite=force)
        except DivergedError:
            show_warnings([f"{path}: diverges, as recorded"])
        written.append(path)
    return limit._replace(recordings=tuple(written))


def _show(limits: dict[str, Limit], vary: str, unit: str, bounds: tuple[float, float]) -> None:
    rows = []
    unit, scale = _shown(unit)
    for name, limit in limits.items():
        if limit.stands_again:
            again = ", ".join(f"{scale * value:g}" for value in limit.stands_again[:5])
            show_warnings([f"{name}: beyond the first fall it stands again at {again} {unit}"])
        sides = [None if side is None else scale * side for side in (limit.stands, limit.falls)]
        written = [["none" if x is None else f"{x:.{n}g}" for x in sides] for n in range(5, 18)]
        differ = next((pair for pair in written if pair[0] != pair[1]), written[-1])
        rows.append((name, *differ, str(limit.runs)))
    low, high = bounds
    print_table(
        f"{vary} from {scale * low:.10g} to {scale * high:.10g} {unit}".replace(" °", "°"),
        ("controller", f"stands, {unit}", f"falls, {unit}", "runs"),
        rows,
    )


def _shown(unit: str) -> tuple[str, float]:
    """Return the unit that a person reads, and what numbers are multiplied by: angles are in degrees."""
    return ("°", degrees(1.0)) if unit == "rad" else (unit, 1.0)


def _study(
    name: str, vary: str, low: str, high: str, points: int, device: str, output: Path | None,
    force: bool, as_json: bool,
) -> None:  # fmt: skip
    import numpy as np

    from trunk_studies.robustness import LimitResult, condition_lines, conditions_of, survival
    from trunk_studies.rows import make_bases
    from trunk_studies.study import Target, read_study

    from .sweep import maker_on

    if output is not None:
        from trunk_views.plots import SUFFIXES

        check_output(output, tuple(SUFFIXES), force, [name])
    maker = maker_on(device)
    study = read_study(name)
    node, _, parameter = vary.partition(".")
    plan = next(iter(make_bases(study).values()))
    bounds, unit = _range(plan.configs, vary, low, high)
    drawn = {str(target) for variable in study.variables for target in variable.targets}
    conditions = conditions_of(plan, {vary, *drawn})
    values = np.linspace(*bounds, points).tolist()
    with progress_bar("runs") as tell:
        array, _, index = parameter.removesuffix("]").partition("[")
        target = Target(node, array, int(index) if index else None)
        curves = survival(study, target, values, tell, maker)
    show_warnings(maker.remarks() if maker else [])
    if output is not None:
        from trunk_studies.stability_map import draw_survival
        from trunk_views.plots import save, with_unit

        title = f"{name}: {next(iter(curves.values())).runs} runs at each value, 95 % intervals"
        save(draw_survival(curves, with_unit(vary, unit), title), output)
    if as_json:
        write_json(LimitResult(vary, unit, *conditions, [], [*curves.values()]))
        return
    unit, scale = _shown(unit)
    print_table(
        f"runs of {name} that stand, % (95 %: Wilson)",
        (f"{vary}, {unit}", *curves),
        [
            (f"{scale * value:.4g}", *(_share(curve.points[k]) for curve in curves.values()))
            for k, value in enumerate(values)
        ],
    )
    for controller, curve in curves.items():
        half = curve.half_falls_at
        at = "not reached" if half is None else f"{scale * half:.4g} {unit}"
        click.echo(f"half of them fall, {controller}: {at}")
    click.echo("\n".join(condition_lines(conditions, plan.simulator.kind)))
    if output is not None:
        click.echo(f"picture: {output}")


def _share(point: SurvivalPoint) -> str:
    return f"{100 * point.share:.0f} ({100 * point.low:.0f} to {100 * point.high:.0f})"
