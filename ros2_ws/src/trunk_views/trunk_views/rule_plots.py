"""Rule bases as pictures: a run's, with triangles, surfaces and path; a rule file's beside its table's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trunk_control.rule_base import RuleBaseConfig
from trunk_core.arrays import Floats
from trunk_core.errors import PlanError
from trunk_core.units import NANOSECONDS
from trunk_recording.joint_table import JointTable

from .plots import COLORS, STYLE, thinned_path
from .run_view import INPUTS, RunView

_MOST_LABELS = 13  # on one axis; more are thinned out
_SURFACE_POINTS = 61  # per side, at least: seven evenly spaced peaks fall on grid points
_POINTS = 201  # along each input of a rule file and its table
_TICKS = 24  # more peaks than this are drawn without their lines
_CELLS = 9  # rows and columns of a table whose cells are written into its surface


class _Input(NamedTuple):
    """One input of the rules, in the unit of its axis."""

    title: str
    peaks: Floats
    labels: tuple[str, ...]
    values: Floats  # of the updates


class Surface(NamedTuple):
    """What a rule base infers on a grid over its universe."""

    errors: Floats  # rad
    rates: Floats  # rad/s
    values: Floats  # [rate, error, output]


def surface_of(config: RuleBaseConfig) -> Surface:
    """Return the values that the rules of a controller infer, on a grid from its first peaks to its last."""
    errors, rates = (
        np.linspace(peaks[0], peaks[-1], max(_SURFACE_POINTS, 2 * len(peaks) - 1), dtype=np.float64)
        for peaks in config.peaks
    )
    infer = config.inference
    grid = [[infer(e, r) for e in errors.tolist()] for r in rates.tolist()]
    return Surface(errors, rates, np.array(grid))


def memberships(view: RunView) -> Figure:
    """Return the triangles of e and e_dot with their labels, and below them the run's inputs over time.

    Raises PlanError for a run whose law has no rules.
    """
    config, terms = _rules_of(view)
    t = (terms.stamp_ns - view.run.begin_ns) / NANOSECONDS
    with rc_context(STYLE):
        figure = Figure(figsize=(10.0, 6.4), layout="constrained")
        grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 1.5))
        for column, axis in enumerate(_inputs(config, terms)):
            triangles = figure.add_subplot(grid[0, column])
            below = figure.add_subplot(grid[1, column], sharex=triangles)
            _triangles(triangles, axis)
            _over_time(below, axis, t)
            if column == 0:
                triangles.set_ylabel("membership")
                below.set_ylabel("time (s)")
    return figure


def surface(view: RunView) -> Figure:
    """Return each table's surface over e and e_dot, with the peaks' labels and the run's path over it.

    Raises PlanError for a run whose law has no rules.
    """
    config, terms = _rules_of(view)
    grid = surface_of(config)
    error, rate = _inputs(config, terms)
    # Inputs beyond the edge act like the edge.
    inside = [np.clip(axis.values, axis.peaks[0], axis.peaks[-1]) for axis in (error, rate)]
    line = thinned_path(*inside)
    with rc_context(STYLE):
        figure = Figure(figsize=(4.9 * len(config.tables), 4.8), layout="constrained")
        for index, table in enumerate(config.tables):
            axes = figure.add_subplot(1, len(config.tables), index + 1)
            drawn = axes.pcolormesh(
                np.degrees(grid.errors),
                grid.rates,
                grid.values[:, :, index],
                cmap="cividis",
                shading="gouraud",
            )
            drawn.set_rasterized(True)
            figure.colorbar(drawn, ax=axes, shrink=0.92, pad=0.02)
            axes.grid(visible=False)
            for place in error.peaks:
                axes.axvline(place, color="white", linewidth=0.6, alpha=0.5, linestyle=":")
            for place in rate.peaks:
                axes.axhline(place, color="white", linewidth=0.6, alpha=0.5, linestyle=":")
            _path_over(axes, line, *inside)
            _cells(axes, table.cells, error, rate)
            axes.set_title(f"{table.title} of {view.title}" if index == 0 else table.title, pad=22)
            axes.set_xlabel(error.title)
            axes.set_ylabel(rate.title if index == 0 else "")
            axes.set_xlim(error.peaks[0], error.peaks[-1])
            axes.set_ylim(rate.peaks[0], rate.peaks[-1])
            _labels_above(axes, error)
            _labels_right(axes, rate)
        handles, names = axes.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=2)
    return figure


def both_surfaces(
    outputs: Sequence[str],
    peaks: tuple[Floats, Floats],
    file: Callable[[Floats, Floats], Floats],
    table: Callable[[Floats, Floats], Floats],
    title: str,
) -> Figure:
    """Return a file's surface, its table's, and their difference, side by side for each output.

    Thin lines are the table's ``peaks``. ``file`` and ``table``: of errors and rates, the outputs in rows.
    """
    e, r = (np.linspace(along[0], along[-1], _POINTS) for along in peaks)
    mesh = [points.ravel() for points in np.meshgrid(e, r, indexing="ij")]
    count = len(outputs)
    theirs, ours = (
        values.reshape(count, _POINTS, _POINTS) for values in (file(*mesh), table(*mesh))
    )
    with rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(12.0, 0.6 + 3.3 * count), layout="constrained")
        axes = figure.subplots(count, 3, squeeze=False, sharex=True, sharey=True)
        for row, name, given, made in zip(axes, outputs, theirs, ours, strict=True):
            lowest, highest = (f(np.stack([given, made])) for f in (np.min, np.max))
            for plot, values, text in zip(
                row,
                (given, made, made - given),
                ("the file", "the table", "the table less the file"),
                strict=True,
            ):
                difference = plot is row[2]
                reach = float(np.max(np.abs(values))) or 1.0
                image = plot.imshow(
                    values.T,
                    extent=(e[0], e[-1], r[0], r[-1]),
                    origin="lower",
                    aspect="auto",
                    cmap="RdBu_r" if difference else "viridis",
                    vmin=-reach if difference else lowest,
                    vmax=reach if difference else highest,
                )
                figure.colorbar(image, ax=plot)
                plot.set(title=f"{name}: {text}")
            for lines, draw_line in (
                (peaks[0], row[1].axvline),
                (peaks[1], row[1].axhline),
            ):
                for at in lines if len(lines) <= _TICKS else ():
                    draw_line(at, color="white", linewidth=0.7, alpha=0.7)
            row[0].set(ylabel="e_dot, rad/s")
        for plot in axes[-1]:
            plot.set(xlabel="e, rad")
        figure.suptitle(title)
    return figure


def _rules_of(view: RunView) -> tuple[RuleBaseConfig, JointTable]:
    config = view.controller
    if not isinstance(config, RuleBaseConfig):
        raise PlanError(
            f"{view.path}: {view.title or 'its controller'} has no rules: give a run of fuzzy_pid or fuzzy"
        )
    terms = view.terms
    if terms is None:
        raise PlanError(
            f"{view.path}: the terms of its controller were not recorded: record them too"
        )
    return config, terms


def _inputs(config: RuleBaseConfig, terms: JointTable) -> tuple[_Input, _Input]:
    error, rate = (terms.column(*column) for column in INPUTS)
    error_peaks, rate_peaks = (np.array(peaks) for peaks in config.peaks)
    axes = config.axes
    return (
        _Input("error e (°)", np.degrees(error_peaks), axes.error, np.degrees(error)),
        _Input("its rate ė (rad/s)", rate_peaks, axes.rate, rate),
    )


def _shown(count: int) -> range:
    """Return the places of the labels that have room, the first and the last among them where possible."""
    return range(0, count, max(1, -(-(count - 1) // (_MOST_LABELS - 1))))


def _range(axis: _Input) -> tuple[float, float]:
    """Return the range of an axis: the universe and all inputs of the run, with a margin."""
    margin = 0.08 * (axis.peaks[-1] - axis.peaks[0])
    low = np.nanmin(axis.values, initial=axis.peaks[0]) - margin
    return float(low), float(np.nanmax(axis.values, initial=axis.peaks[-1]) + margin)


def _triangles(axes: Axes, axis: _Input) -> None:
    """Draw the triangles; beyond the first and the last peak the membership stays 1."""
    low, high = _range(axis)
    feet = np.concatenate(([low], axis.peaks, [high]))
    last = len(axis.peaks) - 1
    for i, label in enumerate(axis.labels):
        color = COLORS[i % len(COLORS)]
        heights = (1.0 if i == 0 else 0.0, 1.0, 1.0 if i == last else 0.0)
        axes.plot(feet[i : i + 3], heights, color=color, linewidth=1.3)
        if i in _shown(len(axis.peaks)):
            axes.text(axis.peaks[i], 1.03, label, ha="center", va="bottom", color=color)
    axes.set_ylim(0.0, 1.14)
    axes.set_yticks((0.0, 0.5, 1.0))
    axes.tick_params(labelbottom=False)
    axes.grid(visible=False, axis="x")


def _over_time(axes: Axes, axis: _Input, t: Floats) -> None:
    """Draw the run's input, time downwards, between the peaks."""
    for peak in axis.peaks:
        axes.axvline(peak, color="#bbbbbb", linewidth=0.6, linestyle=":")
    axes.plot(axis.values, t, color="black", linewidth=1.1)
    axes.set_xlabel(axis.title)
    axes.grid(visible=False, axis="x")
    if len(t) > 1:
        axes.set_ylim(t[-1], t[0])
    axes.set_xlim(*_range(axis))


def _path_over(axes: Axes, line: tuple[Floats, Floats], e: Floats, r: Floats) -> None:
    """Draw the run's path with its first and its last inputs."""
    axes.plot(*line, color="black", linewidth=2.6, solid_capstyle="round")
    axes.plot(*line, color="white", linewidth=1.0, solid_capstyle="round")
    if len(e):
        marks: dict[str, Any] = {"markeredgecolor": "black", "linestyle": "none", "zorder": 4}
        axes.plot(e[:1], r[:1], marker="o", color="white", markersize=10, label="start", **marks)
        axes.plot(e[-1:], r[-1:], marker="s", color="#E69F00", markersize=9, label="end", **marks)


def _cells(axes: Axes, cells: tuple[tuple[str, ...], ...], error: _Input, rate: _Input) -> None:
    """Write each rule's consequent at its pair of peaks, where the table is small enough."""
    if len(error.peaks) > _CELLS or len(rate.peaks) > _CELLS:
        return
    inside_e = 0.016 * (error.peaks[-1] - error.peaks[0])
    inside_r = 0.03 * (rate.peaks[-1] - rate.peaks[0])
    for i, e in enumerate(error.peaks):
        for j, r in enumerate(rate.peaks):
            axes.text(
                np.clip(e, error.peaks[0] + inside_e, error.peaks[-1] - inside_e),
                np.clip(r, rate.peaks[0] + inside_r, rate.peaks[-1] - inside_r),
                cells[i][j],
                ha="center",
                va="center",
                fontsize=7.0,
                color="#222222",
                bbox={"boxstyle": "round,pad=0.16", "fc": "white", "ec": "none", "alpha": 0.72},
                zorder=5,
            )


def _labels_above(axes: Axes, axis: _Input) -> None:
    """Write the labels above their peaks; those at the corners end there, clear of the other axis's."""
    above = axes.secondary_xaxis("top")
    places = _shown(len(axis.peaks))
    above.set_xticks([axis.peaks[i] for i in places], [axis.labels[i] for i in places])
    above.tick_params(length=0, pad=2, labelsize=7.5)
    for place, text in zip(places, above.get_xticklabels(), strict=True):
        text.set_horizontalalignment(_inwards(place, len(axis.peaks), "left", "right"))


def _labels_right(axes: Axes, axis: _Input) -> None:
    """Write the labels to the right of their peaks, as those above them."""
    right = axes.secondary_yaxis("right")
    places = _shown(len(axis.peaks))
    right.set_yticks([axis.peaks[i] for i in places], [axis.labels[i] for i in places])
    right.tick_params(length=0, pad=2, labelsize=7.5)
    for place, text in zip(places, right.get_yticklabels(), strict=True):
        text.set_verticalalignment(_inwards(place, len(axis.peaks), "bottom", "top"))


def _inwards(place: int, count: int, first: str, last: str) -> Any:
    return {0: first, count - 1: last}.get(place, "center")
