"""A study as one HTML page: falls, distributions, the map, paired differences, the worst runs.

The page is text, tables and pictures in the look of the report on runs, whose style it takes. It runs no
script and loads nothing, and its content security policy allows neither.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from markupsafe import Markup
from matplotlib.figure import Figure

from trunk_core.errors import StudyError
from trunk_core.results import Count, Quantity, Result
from trunk_evidence.run_metrics import QUANTITIES
from trunk_views.parts.page import part, policy, rendered
from trunk_views.plots import drawn

from .stability_map import draw, draw_curves, drawn_parameters, panels, scatter
from .statistics import (
    RESAMPLES,
    Falls,
    MetricDistribution,
    PairedDifference,
    Worst,
    compare_study,
    distributions,
    estimate_text,
    falls,
    number_text,
    percent,
    worst_runs,
)
from .sweep_results import METRICS, Results

WORST = 10


@dataclass(frozen=True)
class MetricPart:
    """What the page says of one metric."""

    quantity: Quantity
    distributions: tuple[MetricDistribution, ...]  # all with the same bins
    differences: tuple[PairedDifference, ...]
    scatter: str  # against each drawn parameter, as a data URL; empty: nothing is drawn


@dataclass(frozen=True)
class StudyReport:
    """What the page says."""

    title: str
    scenario: str
    runs: int
    falls: tuple[Falls, ...]
    doubts: tuple[str, ...]
    metrics: tuple[MetricPart, ...]
    maps: tuple[tuple[str, str], ...]  # of each controller, as a data URL
    axes: tuple[str, ...]  # of the maps: two grid variables, or of one picture of curves: one
    metric: str  # of the map and of the worst runs
    worst: tuple[Worst, ...]
    text: str
    provenance: str


@dataclass(frozen=True)
class StudyReportResult(Result, document="study-report-1"):
    """The document of ``trunk study report``."""

    results: Annotated[Path, "The sweep's file"]
    output: Path
    bytes: Count
    runs: Count
    worst: Annotated[Sequence[Worst], "The worst runs, fallen ones first"]


def make_report(
    results: Results, metric: str, floquet: Callable[[int, int], None] | None = None
) -> StudyReport:
    """Return the report. ``metric``: of the map and of the worst runs. Raises StudyError.

    ``floquet``: takes how many of the map's points are done; None: the map is without that line.
    """
    if metric not in METRICS:
        raise StudyError(f"no metric {metric!r}: one of {', '.join(METRICS)}")
    study = results.study
    fall_counts = falls(results)
    differences = compare_study(results) if len(results.controllers) > 1 else []
    axes = _axes(results)
    return StudyReport(
        title=results.path.stem,
        scenario=study.scenario,
        runs=len(results.table),
        falls=tuple(fall_counts),
        doubts=tuple(_doubts(fall_counts)),
        metrics=tuple(
            MetricPart(
                QUANTITIES[name].said(study.words),
                tuple(spreads),
                tuple(d for d in differences if d.metric == name),
                _data_url(scatter(results, name)) if drawn_parameters(results) else "",
            )
            for name, spreads in distributions(results).items()
        ),
        maps=tuple(_maps(results, metric, axes, floquet)) if axes else (),
        axes=axes,
        metric=metric,
        worst=tuple(worst_runs(results, metric, WORST)),
        text=results.study_text,
        provenance=(results.table.schema.metadata or {}).get(b"provenance", b"").decode(),
    )


def render(report: StudyReport) -> str:
    """Return the page."""
    return rendered(
        __package__,
        "report.html.j2",
        report=report,
        policy=policy(),
        style=Markup(part("style.css")),
        quantities=QUANTITIES,
        estimate=estimate_text,
        number=number_text,
        percent=percent,
        resamples=RESAMPLES,
    )


def _doubts(fall_counts: list[Falls]) -> list[str]:
    lines = [
        f"{row.controller} fell in {row.fell} of {row.runs} runs; 95 %: {row.bounds}"
        for row in fall_counts
        if row.fell
    ]
    lines += [
        f"{row.controller}: {row.refused} runs were refused and not run"
        for row in fall_counts
        if row.refused
    ]
    return lines


def _axes(results: Results) -> tuple[str, ...]:
    """Return the first two grid variables of numbers with two values or more, or as many as there are."""
    names = [
        v.name
        for v in results.study.grid
        if len(v.values) > 1 and not isinstance(v.values[0], str | bool)
    ]
    return tuple(names[:2])


def _maps(
    results: Results,
    metric: str,
    axes: tuple[str, ...],
    floquet: Callable[[int, int], None] | None,
) -> list[tuple[str, str]]:
    maps = panels(results, metric, axes, floquet is not None, floquet or (lambda done, of: None))
    if len(axes) == 1:
        picture = draw_curves(maps, metric, axes[0], results.study, "")
        return [("all controllers", _data_url(picture))]
    pictures = []
    for panel in maps:
        picture = draw([panel], metric, axes, results.study, "", among=maps)
        pictures.append((panel.controller, _data_url(picture)))
    return pictures


def _data_url(figure: Figure) -> str:
    return f"data:image/png;base64,{base64.b64encode(drawn(figure, '.png')).decode('ascii')}"
