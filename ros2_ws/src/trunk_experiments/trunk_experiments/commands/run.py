"""``trunk run``: a run in the ROS 2 graph, recorded, with its verdict."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.progress import BarColumn, Progress, TextColumn

from trunk_msgs_util import topics
from trunk_msgs_util.node import middleware

from ..console.outputs import check_not_read, output_options
from ..console.plan_options import files_read, markers_option, plan_of, plan_options
from ..console.terminal import console
from ..errors import PlanError
from ..recorded.run import RecordedRun
from ..runs.files import RunFiles
from ..runs.graph import run_graph
from .metrics import show_metrics


@click.command("run")
@plan_options
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
    type=float,
    default=0.0,
    metavar="FACTOR",
    help="Pace of a lock-step run, as a multiple of real time.  [default: as fast as possible]",
)
def command(
    output: Path | None,
    force: bool,
    lockstep: bool,
    composed: bool,
    markers: bool,
    speed: float,
    **options: Any,
) -> None:
    """Run SCENARIO in the ROS 2 graph: simulator, controller, disturbance, recorder.

    SCENARIO is fig6, fig7, fig8, fig9, demo, or the path of a parameter file.
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
    # What ROS 2 cannot use is refused before a folder is made.
    middleware.prepare(participants=1 + (1 if composed else len(plan.configs)))
    if output is not None:
        for file in RunFiles(output).all:
            check_not_read(file, files_read(options))
    files = RunFiles.for_run(plan, output, force)
    screen = console(stderr=True)
    screen.print(
        f"{plan.scenario}, {plan.turns}: {plan.simulator.duration:g} s "
        f"at {plan.simulator.update_rate:g} Hz, {'lock-step' if lockstep else 'real time'}",
        highlight=False,
    )
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} of {task.total:g} s"),
        console=screen,
        transient=True,
        disable=not screen.is_terminal,
    ) as progress:
        task = progress.add_task("running", total=plan.simulator.duration)
        recording = run_graph(
            plan, files, lambda t: progress.update(task, completed=t), composed=composed
        )
    _verdict(files, RecordedRun(recording))


def _verdict(files: RunFiles, run: RecordedRun) -> None:
    show_metrics(run, "metrics of the run (true error)")
    states, commands = run.count(topics.GROUND_TRUTH), run.count(topics.EFFORT_COMMAND)
    complete = run.recording.complete
    whole = "complete: " if complete else ""  # what is missing stands first
    click.echo(f"{whole}{states} states, {commands} commands recorded")
    click.echo(f"recording: {files.recording}")
    click.echo(f"parameters: {files.parameters}")
    if not complete:
        raise SystemExit(1)
