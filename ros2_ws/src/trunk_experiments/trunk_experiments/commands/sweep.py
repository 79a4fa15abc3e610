"""``trunk sweep``: many compiled runs of a study, into one Parquet file, or which parameter matters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import click

from trunk_core.errors import PlanError
from trunk_core.results import Count, Result
from trunk_evidence.run_metrics import QUANTITIES

from ..console.document import json_option, write_json
from ..console.options import (
    WholeRange,
    check_output,
    device_option,
    exclude,
    jobs_option,
    output_options,
    studies,
)
from ..console.tables import print_table
from ..console.terminal import progress_bar, show_warnings

if TYPE_CHECKING:
    from trunk_studies.batch.kernel import OnDevice
    from trunk_studies.sensitivity import Sensitivity
    from trunk_studies.statistics import Estimate
    from trunk_studies.sweep_execution import Runner, SweepJob

_METRICS = ("iae", "effort", "peak_torque")  # of --sobol
_HEADER = ("parameter", "first order [95 %]", "total [95 %]")


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
@click.argument("study", shell_complete=studies)
@output_options("The Parquet file to write; needed without --sobol.")
@jobs_option("Processes on this machine.")
@click.option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Run the blocks on an existing Dask cluster; needs requirements/cluster.txt.",
)
@device_option
@click.option("--check", is_flag=True, help="Only check the study and say what it would run.")
@click.option(
    "--sobol",
    type=WholeRange(2, 1 << 24),
    metavar="N",
    help="Instead print which drawn parameter matters: Sobol indices by N base points, a power of two; each "
    "controller takes N times (entries + 2) runs.",
)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    help=f"With --sobol: a metric; repeatable. Falls always come first.  [default: {', '.join(_METRICS)}]",
)
@json_option(SweepResult, "trunk_studies.sensitivity:SensitivityResult")
def command(
    study: str,
    output: Path | None,
    force: bool,
    jobs: int | None,
    scheduler: str | None,
    device: str,
    check: bool,
    sobol: int | None,
    metrics: tuple[str, ...],
    as_json: bool,
) -> None:
    """Run STUDY, a YAML file or a shipped study's name: grids and seeded draws over parameters.

    A sweep that was interrupted, even by kill -9, resumes when the same command is given
    again. The same study gives the same file, however it was run.

    --sobol: the share of a metric's variance due to a drawn parameter alone, and with its interactions. A run
    that fell counts as the worst of those that stood; how many fell is shown first.
    """
    from trunk_studies.study import read_study
    from trunk_studies.sweep_execution import SweepJob

    if sobol is not None:
        unused = "output", "force", "scheduler", "check"
        exclude("--sobol writes no file and goes on no cluster", *unused)
        _print_indices(study, sobol, metrics, jobs, device, as_json)
        return
    if metrics:
        raise PlanError("--metric is for --sobol: give that too")
    if output is None:
        raise PlanError("give --output FILE.parquet, or --sobol N")
    check_output(output, (".parquet",), force, [study])
    check_device(device)
    sweep = SweepJob(read_study(study), output)
    if check:
        sweep.check()
        outcomes = None
        line = f"{study}: {sweep.study.total} runs in {sweep.blocks} blocks"
    else:
        outcomes = run_sweep(sweep, jobs, scheduler, device)
        counts = ", ".join(f"{count} {name}" for name, count in outcomes.items())
        line = f"{output}: {sweep.study.total} runs: {counts}"
    if as_json:
        written, ends = (
            None if check else output,
            None if outcomes is None else SweptRuns(**outcomes),
        )
        write_json(SweepResult(study, written, sweep.study.total, sweep.blocks, ends))
    else:
        click.echo(line)


def run_sweep(
    sweep: SweepJob, jobs: int | None, scheduler: str | None, device: str
) -> dict[str, int]:
    """Run a sweep, or the rest of an interrupted one, showing progress; return the count of each outcome."""
    from trunk_studies.sweep_execution import outcome_counts

    maker = maker_on(device)
    total = sweep.study.total
    done = sweep.start()
    runner = runner_of(maker, jobs, scheduler, len(sweep.missing))
    show_warnings(sweep.warnings)
    if done:
        click.echo(f"resuming: {done} of {total} runs are done", err=True)
    with progress_bar("runs") as tell:
        tell(done, total)
        sweep.run(runner, tell)
    sweep.finish()
    show_warnings(maker.remarks() if maker else [])
    return dict(outcome_counts(sweep.output))


def check_device(device: str) -> None:
    """Raise PlanError for options that are not for a device."""
    if device != "cpu":
        exclude(f"--device {device}: one process uses the card", "jobs", "scheduler")


def maker_on(device: str) -> OnDevice | None:
    """Return the maker of runs on a device, None for the processor. Raises as `on_cuda` does."""
    if device == "cpu":
        return None
    from trunk_studies.batch.cuda import on_cuda

    return on_cuda(lambda text: show_warnings([text]))


def runner_of(
    maker: OnDevice | None, jobs: int | None, scheduler: str | None, blocks: int
) -> Runner:
    """Return the runner of at most so many blocks."""
    from trunk_studies.batch.workers import cores
    from trunk_studies.sweep_execution import dask_runner, device_runner, processes

    if maker is not None:
        return device_runner(maker)
    if scheduler is not None:
        return dask_runner(scheduler)
    return processes(max(1, min(jobs or cores(), blocks)))


def _print_indices(
    study: str, n: int, metrics: tuple[str, ...], jobs: int | None, device: str, as_json: bool
) -> None:
    from trunk_studies.rows import make_bases
    from trunk_studies.sensitivity import (
        SensitivityResult,
        check_sensitivity,
        sensitivities,
        total_runs,
    )
    from trunk_studies.study import read_study

    check_device(device)
    read = read_study(study)
    wanted = tuple(dict.fromkeys(metrics)) or _METRICS
    check_sensitivity(read, n, wanted)
    bases = make_bases(read)
    show_warnings(dict.fromkeys(text for base in bases.values() for text in base.warnings))
    runs = total_runs(read, n)
    maker = maker_on(device)
    runner = runner_of(maker, jobs, None, -(-runs // read.block))
    with progress_bar("runs") as tell:
        results = sensitivities(read, bases, n, wanted, runner, tell)
    show_warnings(maker.remarks() if maker else [])
    if as_json:
        write_json(SensitivityResult(study, n, runs, results))
        return
    click.echo(f"{study}: {runs} runs, n = {n}\n")
    for result in results:
        _show(result)


def _show(result: Sensitivity) -> None:
    from trunk_studies.statistics import FELL

    name = "how often it fell" if result.metric == FELL else QUANTITIES[result.metric].label
    title = f"{result.controller}: {name}"
    if result.metric == FELL:
        title += f" ({result.fell} of {result.runs} runs)"
    elif result.filled:
        title += f" ({result.filled} of {result.runs} runs have none and count as the worst)"
    if result.doubtful:
        title += ": doubtful"
    if not result.parameters:
        click.echo(f"{title}: the same in all runs: no parameter matters\n")
        return
    rows = [(i.name, _text(i.first), _text(i.total)) for i in result.parameters]
    print_table(title, _HEADER, rows)


def _text(estimate: Estimate) -> str:
    return f"{estimate.value:.2f} [{estimate.low:.2f}…{estimate.high:.2f}]"
