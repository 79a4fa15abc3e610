"""Stability and performance over one or two parameters of a sweep; over two, as a picture."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from math import nan
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.recording.joint_arrays import Floats

from ..analysis.metrics import QUANTITIES
from ..batch.workers import as_completed_bounded, worker_pool
from ..errors import PlanError, StudyError, SweepError
from ..plans.plan import RunPlan
from ..tuning.floquet import floquet, prepared
from ..views.plot_style import COLORS, STYLE, with_unit
from .bases import plan_of
from .design import design
from .results import METRICS, Results
from .study import Scalar, StudySpec, Variable
from .units import shown_unit

Progress = Callable[[int, int], None]  # takes the amount done and the total
_MANY = 200  # points: fewer are faster without processes
_CHUNK = 16  # points queued per process
QUIET_DEG = 1.0  # RMS of the last 2 s: less is a trunk at rest
_FLOQUET, _FALLEN, _BOUNDARY = COLORS[1], "#bdbdbd", "#000000"


@dataclass(frozen=True)
class MapPanel:
    """One controller's map [y, x]; NaN where no run has a value. Over one variable: one row, and no ``y``."""

    controller: str
    x: Floats
    y: Floats
    values: Floats  # mean over the draws that did not fall
    fallen: Floats  # fraction of the draws that fell
    draws: int  # of a point, at most
    quiet: Floats  # RMS at the end, deg, mean; infinite where all fell
    growth: Floats | None  # Floquet: the largest multiplier, per second


def check_mappable(study: StudySpec, axes: Sequence[str], metric: str) -> None:
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
    upright = np.where(fallen == 0.0, results.column(metric), np.nan)
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
        place = (row["controller"], *(row[axis] for axis in axes))
        if place in seen:
            continue
        seen.add(place)
        try:
            plans.append(plan_of(study, bases, row))
        except ParameterError:
            continue  # refused, and not run either
        j = levels[1].index(float(place[2])) if len(axes) > 1 else 0
        places.append((row["controller"], j, levels[0].index(float(place[1]))))
    for (name, j, i), growth in zip(places, _growths(plans, progress), strict=True):
        grid = grids.setdefault(
            name, np.full((len(levels[-1]) if len(axes) > 1 else 1, len(levels[0])), np.nan)
        )
        grid[j, i] = growth
    return grids


def _growths(plans: list[RunPlan], progress: Progress) -> list[float]:
    """Return each plan's growth, on all cores if there are many; NaN if undefined.

    Plans of one linearised loop have one growth: a push or a start angle changes none.
    """
    loops: dict[bytes, list[int]] = {}
    for k, plan in enumerate(plans):
        with suppress(PlanError):  # the hip hardly moves: its period is too long
            loops.setdefault(pickle.dumps(prepared(plan)), []).append(k)
    growths = [nan] * len(plans)
    alike = list(loops.values())
    for done, (k, growth) in enumerate(
        _numbered_growths([plans[places[0]] for places in alike]), 1
    ):
        for place in alike[k]:
            growths[place] = growth
        progress(done, len(alike))
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
    return number, floquet(plan).growth


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
        figure.colorbar(mesh, ax=list(plots), label=metric_label(metric), extend="both")
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
        why = ["fallen or diverged"] * fell.any() + ["not defined"] * undefined.any()
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
        if min(values.shape) > 1 and np.nanmin(values) < level < np.nanmax(values):
            style: dict[str, Any] = {"linestyles": [dashes], "linewidths": 1.8}
            plot.contour(panel.x, panel.y, values, [level], colors=[color], **style)
            marks[label] = Line2D([], [], color=color, linestyle=dashes, label=label)
    return mesh, marks


def metric_label(metric: str) -> str:
    """Return a metric's label with its unit; another column's name."""
    known = QUANTITIES.get(metric)
    return with_unit(known.label, known.unit) if known else metric


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
