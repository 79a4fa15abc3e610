"""Runs as printed pictures: an overview of everything, or the layout of one of the paper's figures.

Drawn only on `matplotlib.figure.Figure`: no window, no global state, whatever the environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, nan
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from trunk_msgs_util.mechanics import path_height

from ..analysis.metrics import SETTLING_BAND_DEG
from .plot_marks import (
    BAND,
    LIMIT,
    REFERENCE,
    branches,
    context_handles,
    falls,
    legend,
    pulse_spans,
    run_handles,
    turns,
    with_doubts,
)
from .plot_panels import Panel, panels_of
from .plot_style import COLORS, STYLE, line_style
from .run_view import RunView, labels, off_scale

_FAR = 1e12  # m: sine has no digits left there
FIGURES = {
    6: "zero reference",
    7: "step reference",
    8: "zero reference, pulse disturbances",
    9: "step reference, pulse disturbances",
}


def overview(views: Sequence[RunView], names: Sequence[str] | None = None) -> Figure:
    """Return the overview of one run or several: angle, torque, gains, path, phase.

    ``names``: of the runs in the legend; None: their files' and what makes them doubtful.
    """
    names = names or [
        with_doubts(name, view) for name, view in zip(labels(views), views, strict=True)
    ]
    with rc_context(STYLE):
        figure = Figure(figsize=(10.0, 10.8), layout="constrained")
        grid = figure.add_gridspec(4, 1, height_ratios=(1.4, 1.2, 1.15, 1.5))
        angle = figure.add_subplot(grid[0])
        torque = figure.add_subplot(grid[1], sharex=angle)
        panels = panels_of(views)
        small = [figure.add_subplot(cell) for cell in _cells(grid[2], len(panels))]
        path, phase = (figure.add_subplot(cell) for cell in _cells(grid[3], 2))
        _angle(angle, views)
        _torque(torque, views)
        _own(small, panels, views)
        _path(path, views)
        _phase(phase, views)
        for axes in (angle, torque):
            axes.set_xlabel("time (s)")
        legend(figure, "outside upper center", run_handles(names), context_handles(views))
    return figure


def paper_figure(
    views: Sequence[RunView], number: int, names: Sequence[str] | None = None
) -> Figure:
    """Return the runs laid out like the paper's figure 6, 7, 8 or 9: angle over time, one axes."""
    names = names or [
        with_doubts(name, view)
        for name, view in zip(labels(views, lambda view: view.title), views, strict=True)
    ]
    with rc_context({**STYLE, "font.size": 10.0, "axes.labelsize": 10.0, "axes.titlesize": 11.0}):
        figure = Figure(figsize=(8.0, 4.6), layout="constrained")
        axes = figure.add_subplot()
        _angle(axes, views)
        axes.set_title(f"Fig. {number}: trunk angle, {FIGURES[number]}")
        axes.set_xlabel("time (s)")
        context = context_handles(views, limits=False)
        legend(figure, "outside lower center", run_handles(names), context)
    return figure


def _cells(spec: SubplotSpec, columns: int) -> list[SubplotSpec]:
    row = spec.subgridspec(1, columns)
    return [row[0, i] for i in range(columns)]


def _angle(axes: Axes, views: Sequence[RunView]) -> None:
    drawn: set[Any] = set()
    pulse_spans(axes, views)
    turns(axes, views)
    branches(axes, views)
    falls(axes, views)
    for i, view in enumerate(views):
        t, reference = view.table.t, np.degrees(view.table.reference)
        levels = np.flatnonzero(np.diff(reference)) + 1
        shape = (reference[0], *t[levels], *reference[levels])
        if shape not in drawn:  # a shared reference's band is drawn once
            drawn.add(shape)
            axes.fill_between(
                t,
                reference - SETTLING_BAND_DEG,
                reference + SETTLING_BAND_DEG,
                color=BAND,
                alpha=0.22,
                linewidth=0,
            )
            axes.plot(t, reference, color=REFERENCE, linewidth=1.0, linestyle=(0, (2, 2)))
        axes.plot(t, np.degrees(view.table.theta), **line_style(i), zorder=3 + 0.01 * i)
    axes.set_title("Trunk angle" if _any_of_ours(views) else "Angle, as measured")
    axes.set_ylabel(r"angle $\theta$ (°)")
    _whole_time(axes, views)


def _whole_time(axes: Axes, views: Sequence[RunView]) -> None:
    start, end = min(v.table.t[0] for v in views), max(v.table.t[-1] for v in views)
    if start < end:  # not so for a single state
        axes.set_xlim(start, end)


def _peak(view: RunView) -> float:
    """Return the largest magnitude of the torque in N m; 0 if none was recorded."""
    return float(np.max(np.abs(view.table.torque), initial=0.0, where=~np.isnan(view.table.torque)))


def _torque(axes: Axes, views: Sequence[RunView]) -> None:
    pulse_spans(axes, views)
    turns(axes, views, named=True)
    branches(axes, views)
    for i, view in enumerate(views):
        # Torque is held over each period: steps, not slopes.
        axes.step(view.table.t, view.table.torque, where="post", **line_style(i), linewidth=1.2)
    for bound in sorted({b for view in views for b in view.limits if isfinite(b)}):
        axes.axhline(bound, color=LIMIT, linewidth=1.0)
    axes.set_title("Torque on the trunk" if _any_of_ours(views) else "Torque, as commanded")
    axes.set_ylabel(r"torque $\tau$ (N·m)")
    spans = [off_scale(view.table.torque) for view in views]
    wanted = [
        _peak(view) if span is None else span for view, span in zip(views, spans, strict=True)
    ]
    if any(span is not None for span in spans):
        limit = max(wanted)
        axes.set_ylim(-limit, limit)
        peak = max(_peak(view) for view in views)
        axes.set_title(
            f"off scale: short peaks up to {peak:,.0f} N·m",
            loc="right",
            fontsize=8.0,
            fontweight="normal",
            color="#555555",
        )


def _own(grid: Sequence[Axes], panels: Sequence[Panel], views: Sequence[RunView]) -> None:
    for axes, panel in zip(grid, panels, strict=True):
        for i, view in enumerate(views):
            axes.plot(view.table.t, panel.values(view), **line_style(i), linewidth=1.1)
        pulse_spans(axes, views)
        axes.set_title(panel.title)
        axes.set_ylabel(panel.label)
        axes.set_xlabel("time (s)")
        _whole_time(axes, views)
        low, high = axes.get_ylim()
        middle = (low + high) / 2.0
        if high - low < 0.2 * abs(middle):  # a constant gain is a line, not magnified noise
            axes.set_ylim(middle - 0.1 * abs(middle), middle + 0.1 * abs(middle))
        axes.yaxis.set_major_locator(MaxNLocator(4))
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))


def _path(axes: Axes, views: Sequence[RunView]) -> None:
    ours = [(i, view) for i, view in enumerate(views) if not view.run.another_robot]
    if not ours:
        _say(axes, "another robot:\nits hip is not known")
        return
    ranges = [_travelled(view) for _, view in ours]
    low, high = min(low for low, _ in ranges), max(high for _, high in ranges)
    margin = 0.25 * max(high - low, 1.0)
    x = np.linspace(low - margin, high + margin, 800)
    for hip_path in dict.fromkeys(view.hip_path for _, view in ours):
        axes.plot(x, _heights(x, hip_path), color="#888888", linewidth=0.9)
    for (i, view), (least, most) in zip(ours, ranges, strict=True):
        traveled = np.linspace(least, most, 800)
        y = _heights(traveled, view.hip_path)
        # Wide below, narrow above: every run's range shows even where they overlap.
        width = 2.2 + 2.4 * (len(views) - 1 - i)
        color = COLORS[i % len(COLORS)]
        axes.plot(traveled, y, color=color, linewidth=width, solid_capstyle="butt")
        axes.plot(view.table.x[:1], [_height(view)], "o", color="#222222", markersize=5, zorder=5)
    axes.annotate(
        "start",
        (float(ours[0][1].table.x[0]), _height(ours[0][1])),
        xytext=(8, -9),
        textcoords="offset points",
        fontsize=8.0,
    )
    axes.set_title("Hip path, travelled range in colour")
    axes.set_xlabel(r"$x$ (m)")
    sine = all(view.hip_path[2] is None for _, view in ours)
    axes.set_ylabel(r"$y = A\,\sin(k x)$ (m)" if sine else r"$y$ (m)")
    if high - low < 20.0:  # the path of a runaway hip is too long to be drawn to scale
        axes.set_aspect("equal", adjustable="datalim")


def _travelled(view: RunView) -> tuple[float, float]:
    """Return the range of the hip's finite positions in m; 0 and 0 without any."""
    x = view.table.x[np.isfinite(view.table.x) & (np.abs(view.table.x) < _FAR)]
    return (float(x.min()), float(x.max())) if len(x) else (0.0, 0.0)


def _height(view: RunView) -> float:
    x = float(view.table.x[0])
    return path_height(x, *view.hip_path) if abs(x) < _FAR else nan


def _heights(
    x: NDArray[np.floating[Any]], hip_path: tuple[float, float, tuple[float, ...] | None]
) -> list[float]:
    return [path_height(at, *hip_path) for at in x.tolist()]


def _any_of_ours(views: Sequence[RunView]) -> bool:
    return not all(view.run.another_robot for view in views)


def _say(axes: Axes, text: str) -> None:
    """Write a text in place of a plot."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)


def _phase(axes: Axes, views: Sequence[RunView]) -> None:
    if all(np.isnan(view.table.theta_dot).all() for view in views):
        _say(axes, "no velocities were measured")
        return
    for i, view in enumerate(views):
        theta, rate = np.degrees(view.table.theta), view.table.theta_dot
        axes.plot(theta, rate, **line_style(i), linewidth=1.0)
        axes.plot(theta[:1], rate[:1], "o", color="#222222", markersize=5, zorder=5)
        axes.plot(theta[-1:], rate[-1:], "s", color=line_style(i)["color"], markersize=5, zorder=5)
    axes.set_title("Phase portrait (● start, ■ end)")
    axes.set_xlabel(r"angle $\theta$ (°)")
    axes.set_ylabel(r"rate $\dot\theta$ (rad/s)")
