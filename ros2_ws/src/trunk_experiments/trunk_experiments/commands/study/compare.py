"""``trunk study compare``: falls, means and medians, paired differences, histograms."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import count
from math import comb, isfinite
from pathlib import Path

import click

from ...analysis.metrics import QUANTITIES
from ...console.document import json_option, write_json
from ...console.progress import progress_bar
from ...console.tables import print_table
from ...study.compare import FELL, MeanDifference, compare_study
from ...study.intervals import RESAMPLES, Estimate
from ...study.results import METRICS, Results
from ...study.summary import (
    Falls,
    MetricDistribution,
    bins_of,
    counts_in,
    distributions,
    estimate_text,
    falls,
    number_text,
    percent,
)

Row = tuple[str, ...]
_BARS = "·▁▂▃▄▅▆▇█"
_LONG = 500_000  # rows times numbers: some seconds
_INDENT = "  "  # before a controller, below its metric
_FALLS = ("controller", "fell", "share", "95 %", "not run")
_STOOD = ("where it stood", "runs", "mean [95 %]", "median [95 %]")
_PAIRS = ("first - second", "left out", "mean [95 %]", "smaller")
_BINS = ("where it stood", "from", "runs", "to")


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
@click.argument(
    "results",
    metavar="OUT.parquet",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
)
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
    elif form == "csv":
        click.echo(_as_csv(compared.differences), nl=False)
    elif form == "markdown":
        click.echo("\n\n".join(_markdown(title, lines) for title, lines in _tables(compared)))
    else:
        for number, (title, (header, *rows)) in enumerate(_tables(compared)):
            print_table(f"{results}: {title}" if number == 0 else title, header, rows)


def as_values(found: Compared) -> dict[str, object]:
    """Return all of it as plain values; None for what does not exist."""
    return {
        "falls": [
            {
                "controller": one.controller,
                "fell": one.fell,
                "runs": one.runs,
                "refused": one.refused,
                "share": _estimate(one.share),
            }
            for one in found.falls
        ],
        "distributions": [
            {
                "metric": metric,
                "controller": one.controller,
                "stood": one.stood,
                "runs": len(one.values),
                "mean": _estimate(one.mean),
                "median": _estimate(one.median),
                "histogram": None
                if edges is None
                else {"edges": edges.tolist(), "counts": counts_in(one.values, edges)},
            }
            for metric, some in found.distributions.items()
            for edges in [bins_of(some)]
            for one in some
        ],
        "differences": [difference_values(one) for one in found.differences],
    }


def difference_values(difference: MeanDifference) -> dict[str, object]:
    """Return a difference as plain values; None for what does not exist."""
    values = {
        name: None if isinstance(value, float) and not isfinite(value) else value
        for name, value in asdict(difference).items()
    }
    return {**values, "verdict": difference.verdict}


def _estimate(one: Estimate) -> dict[str, float | None]:
    return {name: value if isfinite(value) else None for name, value in one._asdict().items()}


def _as_csv(differences: Sequence[MeanDifference]) -> str:
    text = io.StringIO()
    names = [*(f.name for f in fields(MeanDifference)), "verdict"]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(difference_values(one) for one in differences)
    return text.getvalue()


def _markdown(title: str, lines: Sequence[Row]) -> str:
    header, *rows = lines
    told = [header, ("---",) * len(header), *rows]
    table = "\n".join(f"| {' | '.join(cell.strip() for cell in line)} |" for line in told)
    return f"{title}\n\n{table}"


def _tables(found: Compared) -> list[tuple[str, list[Row]]]:
    """Return titles and lines; the first line of each table is its header."""
    stood = f"mean and median of |quantity| [95 %: percentile bootstrap, {RESAMPLES} resamples]"
    pairs = "first minus second, same grid point and draw, both stood [95 %: as above]"
    by_metric: dict[str, list[MeanDifference]] = {}
    for one in found.differences:
        if one.metric != FELL:
            by_metric.setdefault(one.metric, []).append(one)
    spread = found.distributions
    return [
        ("how often it fell [95 %: Wilson]", [_FALLS, *map(_fall_cells, found.falls)]),
        (stood, [_STOOD, *_by_metric({m: list(map(_cells, some)) for m, some in spread.items()})]),
        (
            pairs,
            [_PAIRS, *_by_metric({m: list(map(_pair, some)) for m, some in by_metric.items()})],
        ),
        (
            "histograms where it stood; the last bin also holds the highest 1 %",
            [_BINS, *_by_metric({m: _histograms(some) for m, some in spread.items()})],
        ),
    ]


def _by_metric(found: Mapping[str, list[Row]]) -> list[Row]:
    """Return a line for each metric, and below it those of its controllers."""
    lines: list[Row] = []
    for metric, rows in found.items():
        if rows:
            quantity = QUANTITIES[metric]
            lines.append((quantity.label, quantity.unit, *[""] * (len(rows[0]) - 2)))
            lines += [(f"{_INDENT}{name}", *rest) for name, *rest in rows]
    return lines


def _fall_cells(one: Falls) -> Row:
    share = percent(one.share.value) if one.share.told else ""
    return one.controller, f"{one.fell} of {one.runs}", share, one.bounds, f"{one.refused} refused"


def _cells(one: MetricDistribution) -> Row:
    return one.controller, one.of_stood, estimate_text(one.mean), estimate_text(one.median)


def _pair(d: MeanDifference) -> Row:
    mean = estimate_text(d.mean_with_bounds)
    smaller = d.smaller_one or ("too few" if d.pairs < 2 else "not shown")
    return f"{d.first} - {d.second}", f"{d.left_out}/{d.left_out + d.pairs}", mean, smaller


def _histograms(found: list[MetricDistribution]) -> list[Row]:
    edges = bins_of(found)
    if edges is None:
        return [(one.controller, "", "none", "") for one in found]
    low, high = number_text(float(edges[0])), number_text(float(edges[-1]))
    return [(one.controller, low, _bars(counts_in(one.values, edges)), high) for one in found]


def _bars(counts: Sequence[int]) -> str:
    """Return counts as bars in one line: a run is never invisible, the fullest bin is full."""
    most = max(*counts, 1)
    return "".join(_BARS[-(-(len(_BARS) - 1) * count // most)] for count in counts)
