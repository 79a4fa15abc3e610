"""Survival curves: the share of runs that stand each value of a parameter."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib import rc_context
from matplotlib.figure import Figure

from ..views.plot_style import STYLE, line_style
from .limit import Survival


def draw(curves: Mapping[str, Survival], axis: str, title: str) -> Figure:
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
