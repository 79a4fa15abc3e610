"""``trunk study``: what a study's results tell: a map, controllers compared, a page, one run again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count
from math import comb
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click

from trunk_core.errors import PlanError
from trunk_core.results import Count, members, values
from trunk_evidence.run_metrics import QUANTITIES, Metrics

from ..console.document import json_option, write_json
from ..console.options import WholeRange, check_output, output_options, results_argument
from ..console.reading import WrittenResult, about_written, open_views, show_warnings_of
from ..console.tables import csv_table, markdown_table, print_table
from ..console.terminal import line_of, progress_bar
from ..console.verbs import OrderedVerbs

if TYPE_CHECKING:
    from trunk_studies.statistics import (
        CompareStudyResult,
        Falls,
        MetricDistribution,
        PairedDifference,
    )
    from trunk_studies.sweep_results import Results

Row = tuple[str, ...]
_BARS = "·▁▂▃▄▅▆▇█"
_LONG_COMPARISON = 500_000  # rows times numbers: some seconds
_LONG_RUN = 100_000  # states, which take seconds
_INDENT = "  "  # before a controller, below its metric
_FALLS = ("controller", "fell", "share", "95 %", "not run")
_STOOD = ("where it did not fall", "runs", "mean [95 %]", "median [95 %]")
_PAIRS = ("first - second", "left out", "mean [95 %]", "smaller")
_UNSHOWN = {"too few pairs": "too few", "not ranked": "not ranked"}
_BINS = ("where it did not fall", "from", "runs", "to")


@click.group("study", cls=OrderedVerbs, gone={"sensitivity": "trunk sweep STUDY --sobol N"})
def command() -> None:
    """Read a study: a map, controllers compared, a report, one of its runs."""


@command.command("map", short_help="Draw a sweep's results over two of its grid's variables.")
@results_argument
@output_options("The picture: .png, .svg or .pdf.  [default: beside the results, .png]")
@click.option(
    "--x", "x", metavar="NAME", help="Grid variable on the horizontal axis.  [default: the first]"
)
@click.option(
    "--y",
    "y",
    metavar="NAME",
    help="Grid variable on the vertical axis.  [default: the second, if any]",
)
@click.option(
    "--metric",
    default="steady_state_error_rms_deg",
    show_default=True,
    help="The column to show as colour.",
)
@click.option("--no-floquet", is_flag=True, help="Leave out the line of the Floquet multipliers.")
@json_option("trunk_studies.stability_map:MapResult")
def map_command(
    results: Path,
    output: Path | None,
    force: bool,
    x: str | None,
    y: str | None,
    metric: str,
    no_floquet: bool,
    as_json: bool,
) -> None:
    """Draw a sweep's results over two of its grid's variables, one panel per controller; over one, as curves.

    Grey, or a cross: more than half of the draws fell. Floquet multipliers are those of the loop linearised
    about the upright trunk, with the hip driven at its initial speed and no torque limit.
    """
    from trunk_studies.stability_map import MapResult, draw, draw_curves, panels
    from trunk_studies.sweep_results import Results
    from trunk_views.plots import SUFFIXES, save

    target = output or results.with_suffix(".png")
    check_output(target, tuple(SUFFIXES), force, [results], chooses_format=True)
    read = Results.read(results)
    axes = choose_axes(read.grid, x, y, str(results))
    with progress_bar("Floquet multipliers") as tell:
        drawn = panels(read, metric, axes, not no_floquet, tell)
    title = f"{results.stem}: {len(read.table)} runs"
    if len(axes) == 1:
        picture = draw_curves(drawn, metric, axes[0], read.study, title)
    else:
        picture = draw(drawn, metric, axes, read.study, title)
    save(picture, target)
    if as_json:
        x, y = axes[0], axes[1] if len(axes) > 1 else None
        write_json(MapResult(results, target, len(read.table), metric, x, y, drawn))
        return
    what = "1 controller" if len(drawn) == 1 else f"{len(drawn)} controllers"
    click.echo(f"{target}: {what} over {' and '.join(axes)}")


def choose_axes(grid: Sequence[str], x: str | None, y: str | None, source: str) -> tuple[str, ...]:
    """Return the horizontal and, if there are two, the vertical grid variable; by default the first two.

    Raises PlanError if there is none.
    """
    known = ", ".join(grid) or "none"
    for name in (x, y):
        if name is not None and name not in grid:
            raise PlanError(f"{source}: {name!r} is not a grid variable; available: {known}")
    if x is not None and x == y:
        raise PlanError(f"{source}: --x and --y are both {x!r}: give two of {known}")
    if not grid:
        raise PlanError(
            f"{source}: a map needs one or two grid variables; it has none: trunk study report "
            "shows the metrics over what is drawn"
        )
    if len(grid) == 1:
        if y is not None:
            raise PlanError(f"{source}: --y {y}: there is no other grid variable: give --x {y}")
        return (grid[0],)
    right = x or next(name for name in grid if name != y)
    return right, y or next(name for name in grid if name != right)


@command.command("compare", short_help="Compare a sweep's controllers over the same draws.")
@results_argument
@json_option("trunk_studies.statistics:CompareStudyResult")
@click.option("--csv", "form", flag_value="csv", help="Print the differences as CSV.")
@click.option("--markdown", "form", flag_value="markdown", help="Print Markdown tables.")
@click.pass_context
def compare_command(ctx: click.Context, results: Path, form: str | None, as_json: bool) -> None:
    """Compare a sweep's controllers over the same draws: falls, means, paired differences, histograms.

    Falls come first; a mean is over the runs that stood, a difference over the draws in which both stood.
    """
    from trunk_studies.sweep_results import Results

    if as_json and form:
        ctx.fail(f"--json and --{form}: give one of them")
    read = Results.read(results)
    compared = _compared(read)
    if as_json:
        write_json(compared)
        return
    if form == "csv":
        click.echo(_as_csv(compared.differences), nl=False)
        return
    tables = _tables(compared, read.study.words)
    if form == "markdown":
        click.echo("\n\n".join(f"{t}\n\n{markdown_table(h, rows)}" for t, h, rows in tables))
    else:
        for number, (title, header, rows) in enumerate(tables):
            print_table(f"{results}: {title}" if number == 0 else title, header, rows)


def _compared(results: Results) -> CompareStudyResult:
    """Compare a sweep's controllers, showing progress. Raises StudyError as `compare_study` does."""
    from trunk_studies.statistics import CompareStudyResult, compare_study, distributions, falls
    from trunk_studies.sweep_results import METRICS

    rows, controllers = len(results.table), len(results.controllers)
    estimates = len(METRICS) * controllers + (len(METRICS) + 1) * comb(controllers, 2)
    with progress_bar("resampling", lines_from=_LONG_COMPARISON) as tell:
        number = count(1)

        def done() -> None:
            tell(next(number) * rows, estimates * rows)

        differences = compare_study(results, done=done)
        spreads = chain.from_iterable(distributions(results, done=done).values())
        return CompareStudyResult(results.path, falls(results), [*spreads], differences)


def _as_csv(differences: Sequence[PairedDifference]) -> str:
    from trunk_studies.statistics import PairedDifference

    return csv_table(
        tuple(members(PairedDifference)), (tuple(values(d).values()) for d in differences)
    )


def _tables(
    compared: CompareStudyResult, words: Callable[[str], str]
) -> list[tuple[str, Row, list[Row]]]:
    """Return titles, headers and rows."""
    from trunk_studies.statistics import FELL, RESAMPLES

    by_metric: dict[str, list[PairedDifference]] = {}
    for difference in compared.differences:
        if difference.metric != FELL:
            by_metric.setdefault(difference.metric, []).append(difference)
    spreads: dict[str, list[MetricDistribution]] = {}
    for spread in compared.distributions:
        spreads.setdefault(spread.metric, []).append(spread)
    stood = {metric: list(map(_cells, group)) for metric, group in spreads.items()}
    pairs = {metric: list(map(_pair, differences)) for metric, differences in by_metric.items()}
    bins = {metric: _histograms(group) for metric, group in spreads.items()}
    return [
        ("how often it fell [95 %: Wilson]", _FALLS, list(map(_fall_cells, compared.falls))),
        (
            f"mean and median, errors unsigned [95 %: percentile bootstrap, {RESAMPLES} resamples]",
            _STOOD,
            _by_metric(stood, words),
        ),
        (
            "first minus second, same grid point and draw, both stood [95 %: as above]",
            _PAIRS,
            _by_metric(pairs, words),
        ),
        (
            "histograms where it did not fall; the last bin also holds the highest 1 %",
            _BINS,
            _by_metric(bins, words),
        ),
    ]


def _by_metric(rows_of: Mapping[str, list[Row]], words: Callable[[str], str]) -> list[Row]:
    """Return a row for each metric, and below it those of its controllers."""
    lines: list[Row] = []
    for metric, rows in rows_of.items():
        if rows:
            quantity = QUANTITIES[metric].said(words)
            lines.append((quantity.label, quantity.terminal_unit, *[""] * (len(rows[0]) - 2)))
            lines += [(f"{_INDENT}{name}", *rest) for name, *rest in rows]
    return lines


def _fall_cells(fall: Falls) -> Row:
    from trunk_studies.statistics import percent

    share = percent(fall.share.value) if fall.share.known else ""
    fell, refused = f"{fall.fell} of {fall.runs}", f"{fall.refused} refused"
    return fall.controller, fell, share, fall.bounds, refused


def _cells(spread: MetricDistribution) -> Row:
    from trunk_studies.statistics import estimate_text

    mean, median = estimate_text(spread.mean), estimate_text(spread.median)
    return spread.controller, spread.of_stood, mean, median


def _pair(d: PairedDifference) -> Row:
    from trunk_studies.statistics import estimate_text

    mean = estimate_text(d.mean_with_bounds)
    smaller = d.smaller_one or _UNSHOWN.get(d.verdict, "not shown")
    return f"{d.first} - {d.second}", f"{d.left_out}/{d.left_out + d.pairs}", mean, smaller


def _histograms(spreads: list[MetricDistribution]) -> list[Row]:
    from trunk_studies.statistics import number_text

    rows: list[Row] = []
    for spread in spreads:
        low, bars, high = "", "none", ""
        if spread.histogram is not None:
            edges, counts = spread.histogram
            low, bars, high = number_text(edges[0]), _bars(counts), number_text(edges[-1])
        rows.append((spread.controller, low, bars, high))
    return rows


def _bars(counts: Sequence[int]) -> str:
    """Return counts as bars in one line: a run is never invisible, the fullest bin is full."""
    most = max(*counts, 1)
    return "".join(_BARS[-(-(len(_BARS) - 1) * count // most)] for count in counts)


@command.command(
    "report",
    short_help="Write one HTML file on a sweep: falls, map, differences, the worst runs.",
)
@results_argument
@output_options("The page to write.  [default: beside the results, .html]")
@click.option(
    "--metric",
    default="iae",
    show_default=True,
    help="The metric that picks the worst runs, and that the map shows.",
)
@click.option(
    "--no-floquet", is_flag=True, help="Leave out the map's line of the Floquet multipliers."
)
@json_option("trunk_studies.study_report:StudyReportResult")
def report_command(
    results: Path,
    output: Path | None,
    force: bool,
    metric: str,
    no_floquet: bool,
    as_json: bool,
) -> None:
    """Write one HTML file on a sweep: falls, map, distributions, differences, the worst ten runs.

    It needs no network and runs no script. Each of the worst runs comes with the command that repeats it.
    """
    from trunk_core.files import atomic_write
    from trunk_studies.study_report import StudyReportResult, make_report, render
    from trunk_studies.sweep_results import Results

    target = output or results.with_suffix(".html")
    check_output(target, (".html", ".htm"), force, [results])
    read = Results.read(results)
    with progress_bar("Floquet multipliers") as tell:
        report = make_report(read, metric, None if no_floquet else tell)
    page = render(report).encode("utf-8")
    with atomic_write(target) as part:
        part.write_bytes(page)
    if as_json:
        write_json(StudyReportResult(results, target, len(page), report.runs, report.worst))
        return
    click.echo(f"{target}: {report.runs} runs, {len(page) / 1e6:.1f} MB")


@dataclass(frozen=True)
class StudyShowResult(WrittenResult, document="study-show-1"):
    """The document of ``trunk study show``."""

    study: Annotated[Path, "The sweep's file"]
    run: Count
    controller: str
    point: Annotated[Count, "Of the grid"]
    draw: Count
    varied: Annotated[Mapping[str, float | str | bool], "The study's entries in this run, by name"]
    status: Literal["ok", "diverged"]
    failure: Annotated[str | None, "Where the plant diverged; null: it did not"]
    metrics: Annotated[Metrics | None, "Those of the row, bit by bit; null: it diverged"]
    report: Annotated[Path | None, "The report on the run; null: not asked for"]


@command.command(
    "show", short_help="Run one of a sweep's runs again, as a recording that verifies."
)
@results_argument
@click.option(
    "--run",
    "number",
    required=True,
    type=WholeRange(0, 2**63 - 1),
    metavar="N",
    help="The run's number, from the column run of the results.",
)
@output_options("The MCAP file to write.", required=True)
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    metavar="FILE.html",
    help="Also write a report on the run.",
)
@json_option(StudyShowResult)
def show_command(
    results: Path,
    number: int,
    output: Path,
    force: bool,
    report: Path | None,
    as_json: bool,
) -> None:
    """Run one of a sweep's runs again, offline, as a recording that verifies.

    Its metrics equal its row bit for bit; otherwise nothing is written, and the error says what differs.
    """
    from trunk_studies.sweep_results import METRICS, Results, record_again, study_run

    check_output(output, (".mcap",), force, [results])
    if report is not None:
        check_output(report, (".html", ".htm"), force, [results], "--report")
        if report.resolve() == output.resolve():
            raise PlanError(f"--report {report}: it is also the output: give another name")
    run = study_run(Results.read(results), number)
    with progress_bar(f"simulating run {number}", _LONG_RUN) as tell:
        diverged = record_again(run, output, force, tell)
    size = None if report is None else _write_report(output, report)
    written = about_written(output)
    controller = str(run.row["controller"])
    if as_json:
        result = StudyShowResult(
            **vars(written),
            study=results,
            run=number,
            controller=controller,
            point=run.row["point"],
            draw=run.row["draw"],
            varied=run.varied,
            status=run.row["status"],
            failure=None if diverged is None else line_of(diverged),
            metrics=None if diverged else Metrics(**{name: run.row[name] for name in METRICS}),
            report=report,
        )
        write_json(result)
        return
    if diverged is not None:
        click.echo(f"diverged, as in the sweep: {line_of(diverged)}")
    elif run.fell:
        click.echo("fell, as in the sweep")
    from trunk_studies.study import shown

    study = run.results.study
    drawn = ", ".join(f"{name} {shown(study, name, value)}" for name, value in run.varied.items())
    click.echo(f"{output}: run {number}, {controller}, {written.states} states; {drawn}")
    if diverged is None:
        click.echo(f"{output}: the metrics equal the row in {results}, bit for bit")
    if size is not None:
        click.echo(f"{report}: 1 run, {size / 1e6:.1f} MB")


def _write_report(recording: Path, target: Path) -> int:
    from trunk_views.run_report import make_report, write

    views = open_views([recording])
    show_warnings_of(views)
    return write(make_report(views), target)
