"""Scatters: a metric of each run that stood against each drawn parameter."""

from __future__ import annotations

from math import ceil

from matplotlib import rc_context
from matplotlib.figure import Figure

from ..analysis.metrics import QUANTITIES
from ..views.plot_style import COLORS, STYLE
from .results import Results

_COLUMNS = 3
_MOST = 2000  # points of a controller in a panel; more would hide one another


def drawn_parameters(results: Results) -> list[str]:
    """Return the names of the parameters that the study draws, in its order."""
    return [v.name for v in results.study.variables if v.distribution is not None]


def scatter(results: Results, metric: str) -> Figure:
    """Return a figure with a panel for each drawn parameter, of at most 2000 runs a controller."""
    names = drawn_parameters(results)
    quantity = QUANTITIES[metric]
    columns = min(_COLUMNS, len(names))
    rows = ceil(len(names) / columns)
    with rc_context(STYLE):
        figure = Figure(figsize=(2.6 * columns + 0.6, 2.1 * rows + 0.4), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False, sharey=True).flat
        for name, panel in zip(names, panels, strict=False):
            for k, controller in enumerate(results.controllers):
                runs = results.of(controller)
                stood = runs.only(runs.fallen == 0.0)
                x, y = stood.column(name)[:_MOST], stood.judged(metric)[:_MOST]
                color = COLORS[k % len(COLORS)]
                panel.plot(x, y, ".", color=color, markersize=3, alpha=0.6, label=controller)
            panel.set_xlabel(name)
        for panel in list(panels):
            panel.set_visible(False)
        label = f"{quantity.label}, {quantity.unit}" if quantity.unit else quantity.label
        figure.supylabel(label, fontsize=9.0)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure
