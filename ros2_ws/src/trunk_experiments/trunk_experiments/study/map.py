"""Stability and performance over two parameters of a sweep, as a picture."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.recording.joint_arrays import Floats

from ..batch.workers import as_completed_bounded, worker_pool
from ..errors import PlanError, StudyError, SweepError
from ..plans.plan import RunPlan
from ..tuning.floquet import floquet
from ..views.plot_style import COLORS, STYLE, line_style
from .bases import plan_of
from .design import design
from .results import METRICS, Results
from .study import Scalar, StudySpec, Variable

if TYPE_CHECKING:
    from .limit import Survival

Progress = Callable[[int, int], None]  # takes the amount done and the total
_MANY = 200  # points: fewer are faster without processes
_CHUNK = 16  # points queued per process
QUIET_DEG = 1.0  # RMS of the last 2 s: less is a trunk at rest
_FLOQUET, _FALLEN, _BOUNDARY = COLORS[1], "#bdbdbd", "#000000"


@dataclass(frozen=True)
class MapPanel:
    """One controller's map [y, x]; NaN where no run has a value."""

    controller: str
    x: Floats
    y: Floats
    values: Floats  # mean over the draws that did not fall
    fallen: Floats  # fraction of the draws that fell
    quiet: Floats  # RMS at the end, deg, mean; infinite where all fell
    growth: Floats | None  # Floquet: the largest multiplier, per second


def check_mappable(study: StudySpec, axes: tuple[str, str], metric: str) -> None:
    """Raise StudyError if the study's results will hold no numbers for the axes or the metric."""
    texts = [v.name for v in study.variables if isinstance(_first(v), str)]
    for name in (*axes, metric):
        if name in texts:
            raise StudyError(f"{study.source}: {name!r} holds no numbers: give another")
    columns = (*METRICS, *(v.name for v in study.variables))
    if metric not in columns:
        raise StudyError(f"{study.source}: no metric {metric!r}: one of {', '.join(columns)}")


def _first(v: Variable) -> Scalar | None:
    values = v.values if v.distribution is None else v.distribution.values
    return values[0] if values else None


def panels(
    results: Results,
    metric: str,
    axes: tuple[str, str],
    with_floquet: bool,
    progress: Progress = lambda done, of: None,
) -> list[MapPanel]:
    """Return a panel per controller. Raises StudyError for axes that are not a grid of numbers.

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
    results: Results, name: str, metric: str, axes: tuple[str, str], growth: Floats | None
) -> MapPanel:
    (x, i), (y, j) = (np.unique(results.column(axis), return_inverse=True) for axis in axes)
    fallen = results.fallen
    upright = np.where(fallen == 0.0, results.column(metric), np.nan)
    rms = np.where(fallen == 0.0, results.column("steady_state_error_rms_deg"), np.inf)

    def mean(values: Floats) -> Floats:
        sums, counts = np.zeros((len(y), len(x))), np.zeros((len(y), len(x)))
        known = ~np.isnan(values)
        np.add.at(sums, (j[known], i[known]), values[known])
        np.add.at(counts, (j[known], i[known]), 1.0)
        with np.errstate(invalid="ignore"):
            return sums / counts

    return MapPanel(name, x, y, mean(upright), mean(fallen), mean(rms), growth)


def _growth(results: Results, axes: tuple[str, str], progress: Progress) -> Mapping[str, Floats]:
    """Return each controller's Floquet growth over the grid, at the first draw of all other variables."""
    study = results.study
    bases = results.bases()
    columns = design(study, 0, study.total)
    grids: dict[str, Floats] = {}
    places: list[tuple[str, int, int]] = []
    plans: list[RunPlan] = []
    seen = set()
    levels = [np.unique(results.column(axis)).tolist() for axis in axes]
    for values in zip(*columns.values(), strict=True):
        row = dict(zip(columns, values, strict=True))
        place = row["controller"], row[axes[0]], row[axes[1]]
        if place in seen:
            continue
        seen.add(place)
        try:
            plans.append(plan_of(study, bases, row))
        except ParameterError:
            continue  # refused, and not run either
        at = levels[1].index(float(place[2])), levels[0].index(float(place[1]))
        places.append((row["controller"], *at))
    for (name, j, i), growth in zip(places, _growths(plans, progress), strict=True):
        grid = grids.setdefault(name, np.full((len(levels[1]), len(levels[0])), np.nan))
        grid[j, i] = growth
    return grids


def _growths(plans: list[RunPlan], progress: Progress) -> list[float]:
    """Return each plan's growth, on all cores if there are many plans; NaN if undefined."""
    growths = [nan] * len(plans)
    for done, (k, growth) in enumerate(_numbered_growths(plans), start=1):
        growths[k] = growth
        progress(done, len(plans))
    return growths


def _numbered_growths(plans: list[RunPlan]) -> Iterator[tuple[int, float]]:
    if len(plans) < _MANY:
        yield from map(_growth_of, enumerate(plans))
        return
    cores = len(os.sched_getaffinity(0))
    try:
        with worker_pool(cores) as pool:
            yield from as_completed_bounded(pool, _growth_of, enumerate(plans), _CHUNK * cores)
    except BrokenProcessPool:
        raise SweepError(
            "a worker process was killed (out of memory?): run the same command again, or give "
            "--no-floquet"
        ) from None


def _growth_of(numbered: tuple[int, RunPlan]) -> tuple[int, float]:
    number, plan = numbered
    try:
        return number, floquet(plan).growth
    except PlanError:  # the hip hardly moves: its period is too long
        return number, nan


def draw(
    maps: list[MapPanel],
    metric: str,
    axes: tuple[str, str],
    title: str,
    among: Sequence[MapPanel] = (),
) -> Figure:
    """Return the panels side by side, with one colour scale for all ``among``, by default for these."""
    values = np.concatenate([panel.values[np.isfinite(panel.values)] for panel in among or maps])
    low, high = np.percentile(values, (2, 98)) if len(values) else (0.0, 1.0)
    with rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(1.2 + 4.2 * len(maps), 4.6), layout="constrained")
        plots = figure.subplots(1, len(maps), sharey=True, squeeze=False)[0]
        for plot, panel in zip(plots, maps, strict=True):
            mesh = _draw_panel(plot, panel, (float(low), float(max(high, low + 1e-12))))
            plot.set_title(panel.controller)
            plot.set_xlabel(axes[0])
        plots[0].set_ylabel(axes[1])
        figure.colorbar(mesh, ax=list(plots), label=metric, extend="both")
        figure.legend(
            handles=_legend(maps), loc="outside lower center", ncols=4 if len(maps) > 1 else 2
        )
        figure.suptitle(title)
    return figure


def _draw_panel(plot: Axes, panel: MapPanel, limits: tuple[float, float]) -> Any:
    plot.set_facecolor(_FALLEN)
    shown = np.ma.masked_invalid(np.where(panel.fallen > 0.5, np.nan, panel.values))
    mesh = plot.pcolormesh(
        panel.x, panel.y, shown, cmap="cividis", vmin=limits[0], vmax=limits[1], shading="nearest"
    )
    for axis, values in (("x", panel.x), ("y", panel.y)):
        if _geometric(values):
            plot.set(**{f"{axis}scale": "log"})
            ticks = plot.xaxis if axis == "x" else plot.yaxis
            ticks.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            ticks.set_major_formatter(StrMethodFormatter("{x:g}"))
            ticks.set_minor_formatter(NullFormatter())
    _line(plot, panel, np.nan_to_num(panel.fallen, nan=1.0), 0.5, _BOUNDARY, "solid")
    level = np.log(np.clip(panel.quiet, 1e-6, 1e6))
    _line(plot, panel, level, float(np.log(QUIET_DEG)), _BOUNDARY, (0, (1.5, 1.5)))
    if panel.growth is not None:
        level = np.log(np.clip(panel.growth, 1e-6, 1e6))
        _line(plot, panel, level, 0.0, _FLOQUET, (0, (6, 2)))
    return mesh


def _line(
    plot: Axes, panel: MapPanel, values: Floats, level: float, color: str, dashes: Any
) -> None:
    if min(values.shape) < 2 or np.isnan(values).all():
        return
    if np.nanmin(values) < level < np.nanmax(values):
        plot.contour(
            panel.x, panel.y, values, [level], colors=[color], linestyles=[dashes], linewidths=1.8
        )


def _geometric(values: Floats) -> bool:
    """Return True for values in geometric progression."""
    if len(values) < 4 or values[0] <= 0.0:
        return False
    ratios = values[1:] / values[:-1]
    return bool(np.ptp(ratios) < 0.01 * ratios[0]) and ratios[0] > 1.001


def _legend(maps: list[MapPanel]) -> list[Any]:
    handles: list[Any] = [
        Patch(color=_FALLEN, label="fallen or diverged"),
        Line2D([], [], color=_BOUNDARY, label="simulated: half the runs fall"),
        Line2D(
            [], [], color=_BOUNDARY, linestyle=(0, (1.5, 1.5)),
            label=f"simulated: RMS {QUIET_DEG:g}° at the end",
        ),
    ]  # fmt: skip
    if any(panel.growth is not None for panel in maps):
        handles.append(
            Line2D([], [], color=_FLOQUET, linestyle=(0, (6, 2)), label="Floquet: multiplier 1")
        )
    return handles


def draw_survival(curves: Mapping[str, Survival], axis: str, title: str) -> Figure:
    """Return a figure with one curve and its 95 % band for each controller."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.5, 4.5), layout="constrained")
        plot = figure.subplots()
        for k, (controller, curve) in enumerate(curves.items()):
            style = line_style(k)
            shares = [100.0 * estimate.value for estimate in curve.shares]
            low = [100.0 * estimate.low for estimate in curve.shares]
            high = [100.0 * estimate.high for estimate in curve.shares]
            plot.plot(curve.values, shares, label=controller, **style)
            plot.fill_between(
                curve.values, low, high, color=style["color"], alpha=0.18, linewidth=0
            )
        plot.set(xlabel=axis, ylabel="runs that stand, %", ylim=(-2.0, 102.0), title=title)
        plot.legend()
    return figure
