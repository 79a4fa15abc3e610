"""``trunk paper``: the paper's figures and claims, reproduced and judged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from trunk_core.errors import PlanError

from ..console.document import json_option, write_json
from ..console.options import check_folder, output_options
from ..console.tables import print_table
from ..console.terminal import steps_told

if TYPE_CHECKING:
    from trunk_studies.paper.reproduction import Reproduction


@click.command("paper")
@output_options(
    "Folder for report.html, paper.json, the figures, still and animated, and the recordings.",
    required=True,
    force="Write into a folder that is not empty.",
)
@click.option(
    "--graph",
    is_flag=True,
    help="Run each figure in the ROS 2 graph as well (lock-step, composed) and compare the bits.",
)
@click.option(
    "--labs",
    is_flag=True,
    help="Also each figure's experiment as a page that runs it in a browser; needs clang and lld.",
)
@json_option("trunk_studies.paper.reproduction:PaperResult")
@click.pass_context
def command(
    context: click.Context,
    output: Path,
    force: bool,
    graph: bool,
    labs: bool,
    as_json: bool,
) -> None:
    """Reproduce Figs 6 to 9 and judge the paper's claims by the numbers.

    Exit code 1 if a graph run's bits differ from the offline run's, or an erratum is not shown.
    """
    from trunk_runs.processes import check_nodes_installed
    from trunk_studies.paper.claims import FIGURES
    from trunk_studies.paper.reproduction import (
        PaperResult,
        paper_numbers,
        reproduce,
        write_report,
    )

    from ..lab.webassembly import missing_tools
    from .lab import write_lab

    if graph:
        check_nodes_installed()
    if labs and (reason := missing_tools()):
        raise PlanError(f"--labs: {reason}")
    check_folder(output, force)
    output.mkdir(parents=True, exist_ok=True)
    with steps_told() as tell:
        result = reproduce(output, graph, tell)
        for figure in FIGURES if labs else ():
            tell(f"making a lab of {figure}")
            write_lab(output / f"{figure}_lab.html", ("pid", "fuzzy_pid"), scenario=figure)
        report = write_report(result, output, tell, labs)
    shown = sum(shown for _, shown, _ in result.errata)
    if as_json:
        write_json(PaperResult(output, report, **vars(paper_numbers(result))))
    else:
        _show(result, report, graph)
    if result.differing or shown < len(result.errata):
        context.exit(1)


def _show(result: Reproduction, report: Path, graph: bool) -> None:
    from trunk_studies.paper.reproduction import lead

    click.echo(f"{lead(result)}\n")
    print_table(
        "claims of the paper, by our runs",
        ("figure", "paper's profile", "practical profile", "the paper"),
        [
            (offline.claim.figures, offline.word, practical.word, offline.claim.quote)
            for offline, _, practical in result.verdicts()
        ],
        texts=3,
        sentences=True,
    )
    if graph:
        same = len(result.graph) - len(result.differing)
        click.echo(f"graph runs with the offline runs' bits: {same} of {len(result.graph)}")
    shown = sum(shown for _, shown, _ in result.errata)
    click.echo(f"errata shown by a computation: {shown} of {len(result.errata)}")
    click.echo(f"report: {report}")
