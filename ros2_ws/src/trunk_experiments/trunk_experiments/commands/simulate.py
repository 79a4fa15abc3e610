"""``trunk simulate``: a run without ROS, into the same kind of recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from trunk_core.errors import PlanError, RecordingError
from trunk_core.parameters.declarations import ParameterError
from trunk_sim.simulation import DivergedError

from ..console.document import json_option, write_json
from ..console.options import (
    PlanResult,
    about_plan,
    check_output,
    default_name,
    exclude,
    files_read,
    markers_option,
    output_options,
    plan_of,
    plan_options,
    push_option,
)
from ..console.reading import WrittenResult, about_written, open_run
from ..console.terminal import line_of, progress_bar, report_error

if TYPE_CHECKING:
    from trunk_runs.plan import RunPlan

    from ..lab.experiment import Experiment


_LONG = 100_000  # states, which take seconds


@dataclass(frozen=True)
class SimulateResult(PlanResult, WrittenResult, document="simulate-1"):
    """The document of ``trunk simulate``."""

    failure: Annotated[str | None, "Why the run ended before its end; null if it did not"]
    same_bits: Annotated[
        bool | None, "An experiment's run has the browser's numbers; null: nothing was compared"
    ]


@click.command("simulate")
@plan_options(required=False)
@push_option
@output_options("The MCAP file to write.  [default: SCENARIO_CONTROLLER.mcap]")
@markers_option
@click.option(
    "--like",
    type=click.Path(path_type=Path, exists=True),
    metavar="RUN|EXPERIMENT.json",
    help="Repeat a recorded run, or an experiment saved in a browser; in place of SCENARIO.",
)
@json_option(SimulateResult)
def command(
    output: Path | None,
    force: bool,
    like: Path | None,
    markers: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Run SCENARIO without ROS: same functions, files, topics and schemas.

    SCENARIO is fig6, fig7, fig8, fig9, demo, cart_pole, or the path of a parameter file.
    """
    if like is not None:
        exclude("--like has the whole run", but=("output", "force", "like", "markers", "as_json"))
    inputs: list[str | Path] = [*files_read(options)]
    if like is None and options["scenario"] is None:
        raise PlanError("give a SCENARIO, or --like RUN or EXPERIMENT.json")
    if output is None:
        of = f"{Path(options['scenario'] or '').stem}_{options['controller']}"
        output = Path(f"{of}.mcap") if like is None else default_name(like, "_again.mcap")
    check_output(output, (".mcap",), force, inputs if like is None else [*inputs, like])
    experiment = _experiment(like, markers) if like and like.suffix.lower() == ".json" else None
    try:
        if experiment is not None:
            plan = experiment.plan
        elif like is None:
            plan = plan_of(**options, extra={"markers": True} if markers else {})
        else:
            plan = open_run(like).plan()
            plan = replace(plan, recorder=replace(plan.recorder, markers=markers))
        states, diverged, difference = recorded(plan, output, force, experiment)
    except (PlanError, ParameterError) as error:
        if like is None:
            raise
        raise RecordingError(f"{like}: it cannot be run again: {error}") from None
    if as_json:
        failure = None if diverged is None else line_of(diverged)
        compared = experiment is not None and bool(experiment.sha256 or difference)
        same_bits = not difference if compared else None
        written, planned = vars(about_written(output)), vars(about_plan(plan))
        write_json(SimulateResult(**written, **planned, failure=failure, same_bits=same_bits))
    else:
        if difference:
            click.echo(f"DIFFERS: {difference}")
        if diverged is None:
            doubts = about_written(output).doubts
            for line in doubts.lines if doubts else ():
                click.echo(line)
            click.echo(
                f"{output}: {states} states, {plan.scenario}, {plan.turns}{_bits(experiment, difference)}"
            )
    if diverged is not None:
        click.get_current_context().exit(report_error(diverged))
    click.get_current_context().exit(1 if difference else 0)


def _experiment(path: Path, markers: bool) -> Experiment:
    from ..lab.experiment import read_experiment

    experiment = read_experiment(path)
    recorder = replace(experiment.plan.recorder, markers=markers)
    return experiment._replace(plan=replace(experiment.plan, recorder=recorder))


def _bits(experiment: Experiment | None, difference: str) -> str:
    if experiment is None or difference:
        return ""
    if not experiment.sha256:
        return "; the browser took no digest, so that the bits are not compared"
    return ": the same bits as in the browser"


def recorded(
    plan: RunPlan, output: Path, force: bool, experiment: Experiment | None
) -> tuple[int, DivergedError | None, str]:
    """Run a plan into a file, showing progress: how many states, why it diverged, how it differs."""
    from trunk_runs.offline_recording import record_offline

    with progress_bar(f"simulating {plan.scenario}", _LONG) as tell_done:
        if experiment is not None:
            from ..lab.experiment import record_experiment

            return record_experiment(experiment, output, force, tell_done)
        try:
            return record_offline(plan, output, overwrite=force, progress=tell_done), None, ""
        except DivergedError as error:
            return 0, error, ""
