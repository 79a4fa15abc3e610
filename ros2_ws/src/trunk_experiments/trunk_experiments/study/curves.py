"""Pictures over one parameter: a metric as curves, how many runs stand, and scatters over what is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..views.plot_style import COLORS, STYLE, line_style
from .map import MapPanel, axis_of, metric_label, scale_axis
from .results import Results
from .study import StudySpec

if TYPE_CHECKING:
    from .limit import Survival

_COLUMNS = 3
_MOST = 2000  # points of a controller in a panel; more would hide one another


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
                y = stood.judged(metric)[:_MOST]
                color = COLORS[k % len(COLORS)]
                panel.plot(x, y, ".", color=color, markersize=3, alpha=0.6, label=controller)
            panel.set_xlabel(axis_of(results.study, name)[0])
        for panel in list(panels):
            panel.set_visible(False)
        figure.supylabel(metric_label(metric), fontsize=9.0)
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
        plots[0].set(ylabel=metric_label(metric), title=title)
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
