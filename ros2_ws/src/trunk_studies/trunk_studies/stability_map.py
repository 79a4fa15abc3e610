"""Stability and performance over one or two parameters of a sweep, as pictures; scatters of what is drawn."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from math import ceil, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from trunk_core.arrays import Floats
from trunk_core.errors import PlanError, StudyError, SweepError
from trunk_core.parameters.declarations import ParameterError
from trunk_core.results import OMITTED, As, Count, Result
from trunk_evidence.run_metrics import QUANTITIES
from trunk_runs.offline_recording import Progress
from trunk_runs.plan import RunPlan
from trunk_sim.plant import TRUNK
from trunk_views.plots import COLORS, STYLE, line_style, with_unit

from .batch.workers import as_completed_bounded, cores, worker_pool
from .rows import plan_of, rows_of
from .study import StudySpec, design, shown_unit
from .sweep_results import Results
from .tuning.floquet import floquet, prepared

if TYPE_CHECKING:
    from .robustness import Survival

_MANY = 200  # points: fewer are faster without processes
_CHUNK = 16  # points queued per process
QUIET_DEG = 1.0  # RMS of the last 2 s: less is a trunk at rest
_COLUMNS = 3
_MOST = 2000  # points of a controller in a panel; more would hide one another
_FLOQUET, _FALLEN, _BOUNDARY = COLORS[1], "#bdbdbd", "#000000"


def _rows(values: Floats) -> list[list[float | None]]:
    return [[None if isnan(value) else value for value in row] for row in values.tolist()]


Rows = list[list[float | None]]
_LIST = As(list[float], lambda values: values.tolist())
_ROWS, _ROWS_OR_NONE = As(Rows, _rows), As(Rows | None, _rows)


@dataclass(frozen=True)
class MapPanel:
    """A controller's map: rows along y (one row without y), columns along x; null: no run has a value."""

    controller: str
    x: Annotated[Floats, _LIST]
    y: Annotated[Floats, _LIST]
    values: Annotated[Floats, _ROWS, "Mean over the draws that stood, as in `study compare`"]
    fallen: Annotated[Floats, _ROWS, "Fraction of the draws that fell"]
    draws: Annotated[int, OMITTED]  # of a point, at most
    quiet: Annotated[Floats, OMITTED]  # RMS at the end, deg, mean; infinite where all fell
    growth: Annotated[Floats | None, _ROWS_OR_NONE, "Floquet: the largest multiplier, per second"]


@dataclass(frozen=True)
class MapResult(Result, document="map-1"):
    """The document of ``trunk study map``."""

    results: Path
    output: Path
    runs: Count
    metric: str
    x: Annotated[str, "Name of the variable"]
    y: Annotated[str | None, "Name of the variable; null: curves over x"]
    panels: list[MapPanel]


def panels(
    results: Results,
    metric: str,
    axes: Sequence[str],
    with_floquet: bool,
    progress: Progress = lambda done, of: None,
) -> list[MapPanel]:
    """Return a panel per controller over one or two variables. Raises StudyError for no grid of numbers.

    ``progress`` is called with the number of points whose Floquet multipliers are done, and the total.
    """
    for name in axes:
        if name not in results.grid:
            known = ", ".join(results.grid) or "none"
            raise StudyError(f"{results.path}: {name!r} is not a grid variable; available: {known}")
    for name in (*axes, metric):
        results.column(name)
    growth = _growth(results, axes, progress) if with_floquet else {}
    growth = {name: grid for name, grid in growth.items() if np.isfinite(grid).any()}
    return [
        _panel(results.of(name), name, metric, axes, growth.get(name))
        for name in results.controllers
    ]


def _panel(
    results: Results, name: str, metric: str, axes: Sequence[str], growth: Floats | None
) -> MapPanel:
    x, i = np.unique(results.column(axes[0]), return_inverse=True)
    y: Floats = np.empty(0)
    j = np.zeros_like(i)
    if len(axes) > 1:
        y, j = np.unique(results.column(axes[1]), return_inverse=True)
    fallen = results.fallen
    upright = np.where(fallen == 0.0, results.ranked(metric), np.nan)
    rms = np.where(fallen == 0.0, results.column("steady_state_error_rms_deg"), np.inf)

    def mean(values: Floats) -> Floats:
        sums, counts = np.zeros((2, len(y) or 1, len(x)))
        known = ~np.isnan(values)
        np.add.at(sums, (j[known], i[known]), values[known])
        np.add.at(counts, (j[known], i[known]), 1.0)
        with np.errstate(invalid="ignore"):
            return sums / counts

    draws = int(np.unique(j * len(x) + i, return_counts=True)[1].max())
    return MapPanel(name, x, y, mean(upright), mean(fallen), draws, mean(rms), growth)


def _growth(results: Results, axes: Sequence[str], progress: Progress) -> Mapping[str, Floats]:
    """Return each controller's Floquet growth over the grid, at the first draw of all other variables."""
    study, bases = results.study, results.bases()
    beside = [0.0] * (2 - len(axes))  # over one variable there is one row
    x, y = [np.unique(results.column(axis)).tolist() for axis in axes] + [[0.0]] * len(beside)
    plans: dict[tuple[str, float, float], RunPlan | None] = {}
    each = study.runs * len(study.contenders)  # rows of a grid point
    for first in range(0, study.total, each):
        for row in rows_of(design(study, first, first + len(study.contenders))):
            at_x, at_y = [float(row[axis]) for axis in axes] + beside
            place = row["controller"], at_x, at_y
            if place not in plans:
                plans[place] = None  # refused, and not run either
                with suppress(ParameterError):
                    plans[place] = plan_of(study, bases, row)
    made = {place: plan for place, plan in plans.items() if plan}
    grids: dict[str, Floats] = {}
    if study.plant != TRUNK:  # multipliers are the trunk's
        return {}
    growths = _growths(list(made.values()), progress)
    for (name, at_x, at_y), growth in zip(made, growths, strict=True):
        grid = grids.setdefault(name, np.full((len(y), len(x)), np.nan))
        grid[y.index(at_y), x.index(at_x)] = growth
    return grids


def _growths(plans: list[RunPlan], progress: Progress) -> list[float]:
    """Return each plan's growth, on all cores if there are many; NaN if undefined.

    Plans of one linearised loop have one growth: a push or a start angle changes none.
    """
    loops: dict[bytes, list[int]] = {}
    lacking: dict[str, str] = {}  # why, by controller
    for k, plan in enumerate(plans):
        try:
            loops.setdefault(pickle.dumps(prepared(plan)), []).append(k)
        except PlanError as error:
            lacking.setdefault(plan.controller_name, str(error))
    growths = [nan] * len(plans)
    alike = list(loops.values())
    for done, (k, growth) in enumerate(
        _numbered_growths([plans[places[0]] for places in alike]), 1
    ):
        if isinstance(growth, str):
            lacking.setdefault(plans[alike[k][0]].controller_name, growth)
            growth = nan
        for place in alike[k]:
            growths[place] = growth
        progress(done, len(alike))
    for name, reason in lacking.items():
        warnings.warn(f"{name}: without Floquet multipliers: {reason}", stacklevel=2)
    return growths


def _numbered_growths(plans: list[RunPlan]) -> Iterator[tuple[int, float | str]]:
    if len(plans) < _MANY:
        yield from map(_growth_of, enumerate(plans))
        return
    count = cores()
    try:
        with worker_pool(count) as pool:
            yield from as_completed_bounded(pool, _growth_of, enumerate(plans), _CHUNK * count)
    except BrokenProcessPool:
        raise SweepError(
            "a worker process was killed (out of memory?): run the same command again, or give "
            "--no-floquet"
        ) from None


def _growth_of(numbered: tuple[int, RunPlan]) -> tuple[int, float | str]:
    """Return a plan's growth, or in words why it has none."""
    number, plan = numbered
    try:
        return number, floquet(plan).growth
    except PlanError as error:
        return number, str(error)


def draw(
    maps: list[MapPanel],
    metric: str,
    axes: Sequence[str],
    study: StudySpec,
    title: str,
    among: Sequence[MapPanel] = (),
) -> Figure:
    """Return maps over two variables side by side, one colour scale for all ``among`` (default: ``maps``)."""
    values = np.concatenate([panel.values[np.isfinite(panel.values)] for panel in among or maps])
    (x, x_scale), (y, y_scale) = (axis_of(study, axis) for axis in axes)
    scaled = [replace(panel, x=x_scale * panel.x, y=y_scale * panel.y) for panel in maps]
    low, high = np.percentile(values, (2, 98)) if len(values) else (0.0, 1.0)
    with rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(1.2 + 4.2 * len(maps), 4.6), layout="constrained")
        plots = figure.subplots(1, len(maps), sharey=True, squeeze=False)[0]
        shown: dict[str, Artist] = {}
        for plot, panel in zip(plots, scaled, strict=True):
            mesh, lines = _draw_panel(plot, panel, (float(low), float(max(high, low + 1e-12))))
            shown |= lines
            plot.set_title(panel.controller)
            plot.set_xlabel(x)
        plots[0].set_ylabel(y)
        figure.colorbar(mesh, ax=list(plots), label=metric_label(metric, study), extend="both")
        if shown:
            columns = 4 if len(maps) > 1 else 2
            figure.legend(handles=list(shown.values()), loc="outside lower center", ncols=columns)
        figure.suptitle(title)
    return figure


def _draw_panel(
    plot: Axes, panel: MapPanel, limits: tuple[float, float]
) -> tuple[Any, dict[str, Artist]]:
    """Draw a panel; return its colours, and the legend's entry of each kind of mark that is there."""
    plot.set_facecolor(_FALLEN)
    marks: dict[str, Artist] = {}
    fell = panel.fallen > 0.5
    undefined = (
        np.isnan(panel.values) & ~fell
    )  # such as a settling time of a trunk that never settles
    if fell.any() or undefined.any():
        why = ["fallen or diverged"] * bool(fell.any()) + ["not defined"] * bool(undefined.any())
        marks[", ".join(why)] = Patch(color=_FALLEN, label=", ".join(why))
    shown = np.ma.masked_invalid(np.where(panel.fallen > 0.5, np.nan, panel.values))
    mesh = plot.pcolormesh(
        panel.x, panel.y, shown, cmap="cividis", vmin=limits[0], vmax=limits[1], shading="nearest"
    )
    scale_axis(plot, "x", panel.x)
    scale_axis(plot, "y", panel.y)
    edge = "half the runs fall" if panel.draws > 1 else "from here on it falls"
    lines: list[tuple[Floats, float, str, Any, str]] = [
        (np.nan_to_num(panel.fallen, nan=1.0), 0.5, _BOUNDARY, "solid", f"simulated: {edge}"),
        (
            np.log(np.clip(panel.quiet, 1e-6, 1e6)), float(np.log(QUIET_DEG)), _BOUNDARY,
            (0, (1.5, 1.5)), f"simulated: RMS {QUIET_DEG:g}° at the end",
        ),
    ]  # fmt: skip
    if panel.growth is not None:
        growth = np.log(np.clip(panel.growth, 1e-6, 1e6))
        lines.append((growth, 0.0, _FLOQUET, (0, (6, 2)), "Floquet: multiplier 1"))
    for values, level, color, dashes, label in lines:
        known = values[~np.isnan(values)]
        if min(values.shape) > 1 and known.size and known.min() < level < known.max():
            style: dict[str, Any] = {"linestyles": [dashes], "linewidths": 1.8}
            plot.contour(panel.x, panel.y, values, [level], colors=[color], **style)
            marks[label] = Line2D([], [], color=color, linestyle=dashes, label=label)
    return mesh, marks


def metric_label(metric: str, study: StudySpec) -> str:
    """Return a metric's label with its unit, in the words of a study's plant; another column's name."""
    known = QUANTITIES.get(metric)
    return with_unit(*known.said(study.words)[:2]) if known else metric


def axis_of(study: StudySpec, name: str) -> tuple[str, float]:
    """Return the label of a variable's axis, with its unit, and what its values are multiplied by there.

    A factor is a plain number.
    """
    unit, scale = shown_unit(study, next(v for v in study.variables if v.name == name))
    return with_unit(name, unit), scale


def scale_axis(plot: Axes, axis: str, values: Floats) -> None:
    """Make an axis logarithmic, with plain numbers at its ticks, where its values are geometric."""
    if _geometric(values):
        plot.set(**{f"{axis}scale": "log"})
        ticks = plot.xaxis if axis == "x" else plot.yaxis
        ticks.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ticks.set_major_formatter(StrMethodFormatter("{x:g}"))
        ticks.set_minor_formatter(NullFormatter())


def _geometric(values: Floats) -> bool:
    """Return True for values in geometric progression."""
    if len(values) < 4 or values[0] <= 0.0:
        return False
    ratios = values[1:] / values[:-1]
    return bool(np.ptp(ratios) < 0.01 * ratios[0]) and ratios[0] > 1.001


def drawn_parameters(results: Results) -> list[str]:
    """Return the names of the parameters that the study draws, in its order."""
    return [v.name for v in results.study.variables if v.distribution is not None]


def scatter(results: Results, metric: str) -> Figure:
    """Return a figure with a panel for each drawn parameter, of at most 2000 runs a controller."""
    names = drawn_parameters(results)
    columns = min(_COLUMNS, len(names))
    rows = ceil(len(names) / columns)
    with rc_context(STYLE):
        figure = Figure(figsize=(2.6 * columns + 0.6, 2.1 * rows + 0.4), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False, sharey=True).flat
        for name, panel in zip(names, panels, strict=False):
            for k, controller in enumerate(results.controllers):
                runs = results.of(controller)
                stood = runs.only(runs.fallen == 0.0)
                x = axis_of(results.study, name)[1] * stood.column(name)[:_MOST]
                y = stood.ranked(metric)[:_MOST]
                color = COLORS[k % len(COLORS)]
                panel.plot(x, y, ".", color=color, markersize=3, alpha=0.6, label=controller)
            panel.set_xlabel(axis_of(results.study, name)[0])
        for panel in list(panels):
            panel.set_visible(False)
        figure.supylabel(metric_label(metric, results.study), fontsize=9.0)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


def draw_curves(
    curves: Sequence[MapPanel], metric: str, axis: str, study: StudySpec, title: str
) -> Figure:
    """Return a metric over one variable, a curve for each controller, its falls marked.

    Below it, if it was computed, the largest Floquet multiplier of each linearised loop.
    """
    label, scale = axis_of(study, axis)
    growing = any(curve.growth is not None for curve in curves)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.5, 6.6 if growing else 4.6), layout="constrained")
        rows = figure.subplots(
            1 + growing, sharex=True, squeeze=False, height_ratios=(2, 1)[: 1 + growing]
        )
        plots: list[Axes] = list(rows[:, 0])
        for k, curve in enumerate(curves):
            style = line_style(k)
            x, fallen = scale * curve.x, curve.fallen[0]
            mean = np.where(fallen > 0.5, np.nan, curve.values[0])
            plots[0].plot(x, mean, marker=".", label=curve.controller, **style)
            few_fell = (fallen > 0.0) & (fallen <= 0.5)
            plots[0].plot(x[few_fell], mean[few_fell], "o", mfc="white", mec=style["color"], ms=6)
            most = x[fallen > 0.5]
            plots[0].plot(  # a row for each controller, below the upper edge
                most, np.full(len(most), 0.97 - 0.035 * k), "x", color=style["color"],
                transform=plots[0].get_xaxis_transform(), label="_fallen",
            )  # fmt: skip
            if curve.growth is not None:
                plots[1].plot(x, curve.growth[0], marker=".", label=curve.controller, **style)
        plots[0].set(ylabel=metric_label(metric, study), title=title)
        low, high = plots[0].get_ylim()
        if any((curve.fallen > 0.5).any() for curve in curves):
            plots[0].set_ylim(low, high + (0.06 + 0.04 * len(curves)) * (high - low))
        if growing:
            plots[1].axhline(1.0, color="#444444", linewidth=0.8)
            plots[1].set(yscale="log", ylabel="Floquet multiplier\nper second; unstable above 1")
        scale_axis(plots[-1], "x", scale * curves[0].x)
        plots[-1].set_xlabel(label)
        figure.legend(handles=_legend(plots[0], curves), loc="outside lower center", ncols=4)
    return figure


def _legend(plot: Axes, curves: Sequence[MapPanel]) -> list[Artist]:
    handles: list[Artist] = plot.get_legend_handles_labels()[0]
    shares = np.concatenate([curve.fallen[0] for curve in curves])
    for marker, label, used in (
        ("o", "some draws fell", (shares > 0.0) & (shares <= 0.5)),
        ("x", "more than half fell", shares > 0.5),
    ):
        if used.any():
            handles.append(
                Line2D([], [], color="#444444", marker=marker, mfc="white", ls="", label=label)
            )
    return handles


def draw_survival(curves: Mapping[str, Survival], axis: str, title: str) -> Figure:
    """Return a figure with one curve and its 95 % band for each controller."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.5, 4.5), layout="constrained")
        plot = figure.subplots()
        for k, (controller, curve) in enumerate(curves.items()):
            style = line_style(k)
            shares = [100.0 * point.share for point in curve.points]
            values = [point.value for point in curve.points]
            low = [100.0 * point.low for point in curve.points]
            high = [100.0 * point.high for point in curve.points]
            plot.plot(values, shares, label=controller, **style)
            plot.fill_between(values, low, high, color=style["color"], alpha=0.18, linewidth=0)
        plot.set(xlabel=axis, ylabel="runs that stand, %", ylim=(-2.0, 102.0), title=title)
        plot.legend()
    return figure
