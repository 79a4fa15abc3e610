"""``trunk run``: a run in the ROS 2 graph, recorded, with its verdict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import click

from trunk_core import topics
from trunk_core.errors import PlanError, RecordingError, RunError
from trunk_core.results import Count
from trunk_evidence.doubts import RecordingResult, about, doubts_of
from trunk_evidence.recorded_run import RecordedRun, silence_of
from trunk_evidence.run_metrics import Metrics
from trunk_evidence.run_table import recorded_metrics
from trunk_msgs_util.node import middleware
from trunk_runs.graph import run_graph
from trunk_runs.processes import check_nodes_installed, claimed_domain, connection_lines
from trunk_runs.run_files import RunFiles

from ..console.document import json_option, write_json
from ..console.options import (
    Number,
    PlanResult,
    about_plan,
    check_not_read,
    external_option,
    files_read,
    markers_option,
    output_options,
    plan_of,
    plan_options,
    push_option,
)
from ..console.reading import about_written
from ..console.terminal import console, line_of, progress_bar, report_error, show_warnings
from .metrics import show_metrics


@dataclass(frozen=True)
class _Recorded(RecordingResult):
    """What was recorded of a run."""

    metrics: Annotated[Metrics | None, "null where the run failed, or there is nothing to measure"]
    states: Annotated[Count | None, "Recorded states; null: no file to read"]
    commands: Count | None


@dataclass(frozen=True)
class RunResult(PlanResult, _Recorded, document="run-1"):
    """The document of ``trunk run``."""

    lockstep: bool
    parameters: Annotated[Path, "The nodes' parameter file"]
    failure: Annotated[str | None, "Why the run ended before its end, or has no metrics; else null"]


@click.command("run")
@plan_options()
@push_option
@external_option
@output_options(
    "Folder for the recording, parameters and logs.  [default: runs/TIME_SCENARIO_CONTROLLER]",
    force="Replace the files of a run that is in the folder.",
)
@click.option(
    "--lockstep", is_flag=True, help="Step when every node has answered: the same bits each time."
)
@click.option(
    "--composed", is_flag=True, help="All nodes in one process; in lock-step many times faster."
)
@markers_option
@click.option(
    "--speed",
    type=Number(""),
    default=0.0,
    metavar="FACTOR",
    help="Pace of a lock-step run, as a multiple of real time.  [default: as fast as possible]",
)
@json_option(RunResult)
def command(
    output: Path | None,
    force: bool,
    lockstep: bool,
    composed: bool,
    markers: bool,
    speed: float,
    as_json: bool,
    **options: Any,
) -> None:
    """Run SCENARIO in the ROS 2 graph: simulator, controller, disturbance, recorder.

    SCENARIO is fig6, fig7, fig8, fig9, demo, cart_pole, or the path of a parameter file.
    """
    everywhere: dict[str, object] = {"lockstep.enabled": True} if lockstep else {}
    if markers:
        everywhere["markers"] = True
    if speed:
        if not lockstep:
            raise PlanError(f"--speed {speed:g}: only a lock-step run can be paced; add --lockstep")
        everywhere["lockstep.speed"] = speed
    plan = plan_of(**options, extra=everywhere)
    if not plan.simulator.duration:
        raise PlanError("simulator: duration is 0: a recorded run needs an end; give --duration S")
    # Settings that ROS 2 cannot use, no ROS 2, and a second run are refused before a folder is made.
    middleware.prepare()
    check_nodes_installed()
    click.get_current_context().with_resource(claimed_domain())
    if output is not None:
        for file in RunFiles(output).all:
            check_not_read(file, files_read(options))
    files = RunFiles.for_run(plan, output, force)
    click.get_current_context().call_on_close(files.settle)
    screen = console(stderr=True)
    screen.print(
        f"{plan.scenario}, {plan.turns}: {plan.simulator.duration:g} s "
        f"at {plan.simulator.update_rate:g} Hz, {'lock-step' if lockstep else 'real time'}",
        highlight=False,
    )
    duration = plan.simulator.duration
    for line in connection_lines(plan) if plan.external is not None else ():
        screen.print(line, highlight=False, markup=False, soft_wrap=True)
    planned = {**vars(about_plan(plan)), "lockstep": lockstep, "parameters": files.parameters}
    try:
        with progress_bar("running") as done:
            recording = run_graph(
                plan,
                files,
                lambda t: done(t, duration, f"{t:.1f} of {duration:g} s"),
                composed=composed,
                note=lambda line: screen.print(
                    line, highlight=False, markup=False, soft_wrap=not screen.is_terminal
                ),
            )
    except RunError as error:
        if not as_json:
            raise
        written = vars(about_written(files.recording))
        failure = line_of(error)
        write_json(RunResult(**written, commands=None, metrics=None, **planned, failure=failure))
        click.get_current_context().exit(report_error(error))
    run = RecordedRun(recording)
    if as_json:
        write_run(run, planned)
    else:
        show_run(files, run)
    if not recording.complete:
        click.get_current_context().exit(1)
    if silence_of(run):
        click.get_current_context().exit(2)


def write_run(run: RecordedRun, planned: dict[str, Any]) -> None:
    """Write a run's document. One without metrics is a failed run: ends with the error's exit code."""
    show_warnings(run.recording.further_warnings)
    recorded = vars(about(run, doubts_of(run)))
    measured: Metrics | None = None
    error: RecordingError | None = None
    try:
        measured = recorded_metrics(run)
    except RecordingError as without:
        error = without
    states, commands = run.count(topics.GROUND_TRUTH), run.count(topics.EFFORT_COMMAND)
    failure = None if error is None else line_of(error)
    write_json(
        RunResult(
            **recorded,
            metrics=measured,
            states=states,
            commands=commands,
            **planned,
            failure=failure,
        )
    )
    if error:
        click.get_current_context().exit(report_error(error))


def show_run(files: RunFiles, run: RecordedRun, interrupted: bool = False) -> None:
    """Print a run's metrics, and where its files are.

    One that was ``interrupted`` may be too short for metrics; any other then raises RecordingError, after its
    files were named.
    """
    error: RecordingError | None = None
    try:
        show_metrics(run, "metrics of the run (true error)")
    except RecordingError as without:
        error = without
    if error and interrupted:
        show_warnings([f"stopped before there was anything to measure: {line_of(error)}"])
    states, commands = run.count(topics.GROUND_TRUTH), run.count(topics.EFFORT_COMMAND)
    whole = "complete: " if run.recording.complete else ""  # what is missing was printed first
    click.echo(f"{whole}{states} states, {commands} commands recorded")
    click.echo(f"recording: {files.recording}")
    click.echo(f"parameters: {files.parameters}")
    if error and not interrupted:
        raise error
