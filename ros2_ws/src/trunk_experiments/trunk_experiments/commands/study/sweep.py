"""``trunk sweep``: many compiled runs of a study, into one Parquet file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import click

from ...console.document import json_option, write_json
from ...console.options import device_option, names_or_files, studies
from ...console.outputs import check_output, output_options
from ...console.progress import progress_bar
from ...console.terminal import show_warnings
from ...errors import PlanError
from ...results import Count, Result

if TYPE_CHECKING:
    from ...batch.kernel import OnDevice
    from ...study.sweep import Runner, SweepJob


class SweptRuns(NamedTuple):
    """How many runs ended how."""

    ok: Count
    diverged: Count
    refused: Count


@dataclass(frozen=True)
class SweepResult(Result, document="sweep-1"):
    """The document of ``trunk sweep``."""

    study: str
    output: Annotated[Path | None, "null: --check"]
    runs: Count
    blocks: Count
    outcomes: Annotated[SweptRuns | None, "How many runs ended how; null: --check"]


@click.command("sweep")
@click.argument("study", shell_complete=names_or_files(studies))
@output_options("The Parquet file to write.", required=True)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    help="Processes on this machine.  [default: one per core]",
)
@click.option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Run the blocks on an existing Dask cluster; needs requirements/cluster.txt.",
)
@device_option
@click.option("--check", is_flag=True, help="Only check the study and say what it would run.")
@json_option(SweepResult)
def command(
    study: str,
    output: Path,
    force: bool,
    jobs: int | None,
    scheduler: str | None,
    device: str,
    check: bool,
    as_json: bool,
) -> None:
    """Run STUDY, a YAML file or a shipped study's name: grids and seeded draws over parameters.

    A sweep that was interrupted, even by kill -9, resumes when the same command is given
    again. The same study gives the same file, however it was run.
    """
    from ...study.study import read_study
    from ...study.sweep import SweepJob

    check_output(output, (".parquet",), force, [study])
    check_device(device, jobs, scheduler)
    sweep = SweepJob(read_study(study), output)
    if check:
        sweep.check()
        outcomes = None
        line = f"{study}: {sweep.study.total} runs in {sweep.blocks} blocks"
    else:
        outcomes = run_sweep(sweep, jobs, scheduler, device)
        line = ended(sweep, outcomes)
    if as_json:
        written, ends = (
            None if check else output,
            None if outcomes is None else SweptRuns(**outcomes),
        )
        write_json(SweepResult(study, written, sweep.study.total, sweep.blocks, ends))
    else:
        click.echo(line)


def ended(sweep: SweepJob, outcomes: Mapping[str, int]) -> str:
    """Return a line on how a sweep's runs ended."""
    counts = ", ".join(f"{count} {name}" for name, count in outcomes.items())
    return f"{sweep.output}: {sweep.study.total} runs: {counts}"


def run_sweep(
    sweep: SweepJob,
    jobs: int | None = None,
    scheduler: str | None = None,
    device: str = "cpu",
) -> dict[str, int]:
    """Run a sweep, or the rest of an interrupted one, showing progress; return the count of each outcome."""
    from ...study.sweep import outcome_counts

    maker = maker_on(device)
    total = sweep.study.total
    done = sweep.start()
    runner = runner_of(maker, jobs, scheduler, len(sweep.missing))
    show_warnings(sweep.warnings)
    if done:
        click.echo(f"resuming: {done} of {total} runs are done", err=True)
    with progress_bar("runs") as tell:
        tell(done, total)

        def progress(runs: int) -> None:
            nonlocal done
            done += runs
            tell(done, total)

        sweep.run(runner, progress)
    sweep.finish()
    show_warnings(maker.remarks() if maker else [])
    return dict(outcome_counts(sweep.output))


def check_device(device: str, jobs: int | None, scheduler: str | None = None) -> None:
    """Raise PlanError for options that exclude one another."""
    for other, value in (("--jobs", jobs), ("--scheduler", scheduler)):
        if device != "cpu" and value is not None:
            raise PlanError(f"--device {device}: one process uses the card: leave {other} out")


def maker_on(device: str) -> OnDevice | None:
    """Return the maker of runs on a device, None for the processor. Raises as `on_cuda` does."""
    if device == "cpu":
        return None
    from ...batch.cuda import on_cuda

    return on_cuda(lambda text: show_warnings([text]))


def runner_of(
    maker: OnDevice | None, jobs: int | None, scheduler: str | None, blocks: int
) -> Runner:
    """Return the runner of at most so many blocks."""
    from ...study.sweep import dask_runner, device_runner, processes

    if maker is not None:
        return device_runner(maker)
    if scheduler is not None:
        return dask_runner(scheduler)
    return processes(max(1, min(jobs or len(os.sched_getaffinity(0)), blocks)))
