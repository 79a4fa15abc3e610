"""``trunk study sensitivity``: which of a study's drawn parameters matters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ...analysis.metrics import QUANTITIES
from ...console.document import json_option, write_json
from ...console.options import device_option, names_or_files, studies
from ...console.progress import progress_bar
from ...console.tables import print_table
from ...console.terminal import show_warnings

if TYPE_CHECKING:
    from ...study.compare import Estimate
    from ...study.sensitivity import Sensitivity

_METRICS = ("iae", "effort", "peak_torque")
_HEADER = ("parameter", "first order [95 %]", "total [95 %]")


@click.command("sensitivity")
@click.argument("study", shell_complete=names_or_files(studies))
@click.option(
    "--n",
    "n",
    type=int,
    default=256,
    show_default=True,
    help="Base points, a power of two; each controller takes n times (entries + 2) runs.",
)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    help=f"A metric; repeatable. Falls always come first.  [default: {', '.join(_METRICS)}]",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    help="Processes on this machine.  [default: one per core]",
)
@device_option
@json_option("study.sensitivity:SensitivityResult")
def command(
    study: str, n: int, metrics: tuple[str, ...], jobs: int | None, device: str, as_json: bool
) -> None:
    """Show which drawn parameter of STUDY matters: Sobol indices over its distributions.

    First order: the share of a metric's variance due to a parameter alone. Total: its interactions with all
    others included. A run that fell counts as the worst of those that stood; how many fell is shown first.
    """
    from ...study.rows import make_bases
    from ...study.sensitivity import SensitivityResult, check_sensitivity, sensitivities, total_runs
    from ...study.study import read_study
    from .sweep import check_device, maker_on, runner_of

    check_device(device, jobs)
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
    from ...study.compare import FELL

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
