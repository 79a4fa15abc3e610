"""``trunk study compare``: falls, means and medians, paired differences, histograms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import count
from math import comb, isfinite
from pathlib import Path

import click

from ...analysis.metrics import QUANTITIES
from ...console.document import json_option, write_json
from ...console.options import results_argument
from ...console.progress import progress_bar
from ...console.tables import csv_table, markdown_table, print_table
from ...study.compare import (
    FELL,
    RESAMPLES,
    Estimate,
    Falls,
    MeanDifference,
    MetricDistribution,
    bins_of,
    compare_study,
    counts_in,
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
_UNSHOWN = {"too few pairs": "too few", "not judged": "not judged"}
_BINS = ("where it did not fall", "from", "runs", "to")


@dataclass(frozen=True)
class Compared:
    """All that is shown of a study's controllers, in the order in which it is shown."""

    falls: list[Falls]
    distributions: dict[str, list[MetricDistribution]]
    differences: list[MeanDifference]

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


@click.command("compare")
@results_argument
@json_option("compare-study-1")
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
        write_json("compare-study-1", {"study": results, **as_values(compared)})
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


def as_values(compared: Compared) -> dict[str, object]:
    """Return all of it as plain values; None for what does not exist."""
    return {
        "falls": [
            {
                "controller": fall.controller,
                "fell": fall.fell,
                "runs": fall.runs,
                "refused": fall.refused,
                "share": _estimate(fall.share),
            }
            for fall in compared.falls
        ],
        "distributions": [
            {
                "metric": metric,
                "controller": spread.controller,
                "stood": spread.stood,
                "runs": len(spread.values),
                "mean": _estimate(spread.mean),
                "median": _estimate(spread.median),
                "histogram": None
                if edges is None
                else {"edges": edges.tolist(), "counts": counts_in(spread.values, edges)},
            }
            for metric, spreads in compared.distributions.items()
            for edges in [bins_of(spreads)]
            for spread in spreads
        ],
        "differences": [difference_values(difference) for difference in compared.differences],
    }


def difference_values(difference: MeanDifference) -> dict[str, object]:
    """Return a difference as plain values; None for what does not exist."""
    values = {
        name: None if isinstance(value, float) and not isfinite(value) else value
        for name, value in asdict(difference).items()
    }
    return {**values, "verdict": difference.verdict}


def _estimate(estimate: Estimate) -> dict[str, float | None]:
    return {name: value if isfinite(value) else None for name, value in estimate._asdict().items()}


def _as_csv(differences: Sequence[MeanDifference]) -> str:
    names = (*(field.name for field in fields(MeanDifference)), "verdict")
    return csv_table(names, (tuple(difference_values(d).values()) for d in differences))


def _tables(compared: Compared) -> list[tuple[str, Row, list[Row]]]:
    """Return titles, headers and rows."""
    by_metric: dict[str, list[MeanDifference]] = {}
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


def _pair(d: MeanDifference) -> Row:
    mean = estimate_text(d.mean_with_bounds)
    smaller = d.smaller_one or _UNSHOWN.get(d.verdict, "not shown")
    return f"{d.first} - {d.second}", f"{d.left_out}/{d.left_out + d.pairs}", mean, smaller


def _histograms(spreads: list[MetricDistribution]) -> list[Row]:
    edges = bins_of(spreads)
    if edges is None:
        return [(spread.controller, "", "none", "") for spread in spreads]
    low, high = number_text(float(edges[0])), number_text(float(edges[-1]))
    return [(s.controller, low, _bars(counts_in(s.values, edges)), high) for s in spreads]


def _bars(counts: Sequence[int]) -> str:
    """Return counts as bars in one line: a run is never invisible, the fullest bin is full."""
    most = max(*counts, 1)
    return "".join(_BARS[-(-(len(_BARS) - 1) * count // most)] for count in counts)
