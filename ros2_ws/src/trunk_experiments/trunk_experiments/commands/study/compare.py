"""``trunk study compare``: falls, means and medians, paired differences, histograms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from math import comb
from pathlib import Path
from typing import Annotated

import click

from ...analysis.metrics import QUANTITIES
from ...console.document import json_option, write_json
from ...console.options import results_argument
from ...console.progress import progress_bar
from ...console.tables import csv_table, markdown_table, print_table
from ...results import Result, members, values
from ...study.compare import (
    FELL,
    RESAMPLES,
    Falls,
    MetricDistribution,
    PairedDifference,
    compare_study,
    distributions,
    estimate_text,
    falls,
    number_text,
    percent,
)
from ...study.results import METRICS, Results

Row = tuple[str, ...]
_BARS = "·▁▂▃▄▅▆▇█"
_LONG = 500_000  # rows times numbers: some seconds
_INDENT = "  "  # before a controller, below its metric
_FALLS = ("controller", "fell", "share", "95 %", "not run")
_STOOD = ("where it did not fall", "runs", "mean [95 %]", "median [95 %]")
_PAIRS = ("first - second", "left out", "mean [95 %]", "smaller")
_UNSHOWN = {"too few pairs": "too few", "not ranked": "not ranked"}
_BINS = ("where it did not fall", "from", "runs", "to")


@dataclass(frozen=True)
class Compared:
    """All that is shown of a study's controllers, in the order in which it is shown."""

    falls: list[Falls]
    distributions: dict[str, list[MetricDistribution]]
    differences: list[PairedDifference]

    @classmethod
    def of(cls, results: Results) -> Compared:
        """Compare a sweep's controllers, showing progress. Raises StudyError as `compare_study` does."""
        rows, controllers = len(results.table), len(results.controllers)
        estimates = len(METRICS) * controllers + (len(METRICS) + 1) * comb(controllers, 2)
        with progress_bar("resampling", lines_from=_LONG) as tell:
            number = count(1)

            def done() -> None:
                tell(next(number) * rows, estimates * rows)

            differences = compare_study(results, done=done)
            return cls(falls(results), distributions(results, done=done), differences)


@dataclass(frozen=True)
class CompareStudyResult(Result, document="compare-study-1"):
    """The document of ``trunk study compare``."""

    study: Annotated[Path, "The sweep's file"]
    falls: Annotated[Sequence[Falls], "How often each controller fell"]
    distributions: Annotated[Sequence[MetricDistribution], "Over the runs in which it stood"]
    differences: Sequence[PairedDifference]


@click.command("compare")
@results_argument
@json_option(CompareStudyResult)
@click.option("--csv", "form", flag_value="csv", help="Print the differences as CSV.")
@click.option("--markdown", "form", flag_value="markdown", help="Print Markdown tables.")
@click.pass_context
def command(ctx: click.Context, results: Path, form: str | None, as_json: bool) -> None:
    """Compare a sweep's controllers over the same draws: falls, means, paired differences, histograms.

    Falls come first; a mean is over the runs that stood, a difference over the draws in which both stood.
    """
    if as_json and form:
        ctx.fail(f"--json and --{form}: give one of them")
    compared = Compared.of(Results.read(results))
    if as_json:
        spreads = [spread for group in compared.distributions.values() for spread in group]
        write_json(CompareStudyResult(results, compared.falls, spreads, compared.differences))
        return
    if form == "csv":
        click.echo(_as_csv(compared.differences), nl=False)
        return
    tables = _tables(compared)
    if form == "markdown":
        click.echo("\n\n".join(f"{t}\n\n{markdown_table(h, rows)}" for t, h, rows in tables))
    else:
        for number, (title, header, rows) in enumerate(tables):
            print_table(f"{results}: {title}" if number == 0 else title, header, rows)


def _as_csv(differences: Sequence[PairedDifference]) -> str:
    return csv_table(
        tuple(members(PairedDifference)), (tuple(values(d).values()) for d in differences)
    )


def _tables(compared: Compared) -> list[tuple[str, Row, list[Row]]]:
    """Return titles, headers and rows."""
    by_metric: dict[str, list[PairedDifference]] = {}
    for difference in compared.differences:
        if difference.metric != FELL:
            by_metric.setdefault(difference.metric, []).append(difference)
    spreads = compared.distributions
    stood = {metric: list(map(_cells, group)) for metric, group in spreads.items()}
    pairs = {metric: list(map(_pair, differences)) for metric, differences in by_metric.items()}
    bins = {metric: _histograms(group) for metric, group in spreads.items()}
    return [
        ("how often it fell [95 %: Wilson]", _FALLS, list(map(_fall_cells, compared.falls))),
        (
            f"mean and median, errors unsigned [95 %: percentile bootstrap, {RESAMPLES} resamples]",
            _STOOD,
            _by_metric(stood),
        ),
        (
            "first minus second, same grid point and draw, both stood [95 %: as above]",
            _PAIRS,
            _by_metric(pairs),
        ),
        (
            "histograms where it did not fall; the last bin also holds the highest 1 %",
            _BINS,
            _by_metric(bins),
        ),
    ]


def _by_metric(rows_of: Mapping[str, list[Row]]) -> list[Row]:
    """Return a row for each metric, and below it those of its controllers."""
    lines: list[Row] = []
    for metric, rows in rows_of.items():
        if rows:
            quantity = QUANTITIES[metric]
            lines.append((quantity.label, quantity.terminal_unit, *[""] * (len(rows[0]) - 2)))
            lines += [(f"{_INDENT}{name}", *rest) for name, *rest in rows]
    return lines


def _fall_cells(fall: Falls) -> Row:
    share = percent(fall.share.value) if fall.share.known else ""
    fell, refused = f"{fall.fell} of {fall.runs}", f"{fall.refused} refused"
    return fall.controller, fell, share, fall.bounds, refused


def _cells(spread: MetricDistribution) -> Row:
    mean, median = estimate_text(spread.mean), estimate_text(spread.median)
    return spread.controller, spread.of_stood, mean, median


def _pair(d: PairedDifference) -> Row:
    mean = estimate_text(d.mean_with_bounds)
    smaller = d.smaller_one or _UNSHOWN.get(d.verdict, "not shown")
    return f"{d.first} - {d.second}", f"{d.left_out}/{d.left_out + d.pairs}", mean, smaller


def _histograms(spreads: list[MetricDistribution]) -> list[Row]:
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
