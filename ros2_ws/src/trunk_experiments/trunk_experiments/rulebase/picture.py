"""The file's surface, the table's, and their difference, side by side for each output."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from ..views.plots import STYLE
from .importing import Imported

_POINTS = 201  # along each input
_TICKS = 24  # more peaks than this are drawn without their lines


def draw(imported: Imported, title: str) -> Figure:
    """Return the figure; thin lines are the table's peaks."""
    table = imported.table
    e, r = (
        np.linspace(peaks[0], peaks[-1], _POINTS) for peaks in (table.error_peaks, table.rate_peaks)
    )
    mesh = [points.ravel() for points in np.meshgrid(e, r, indexing="ij")]
    count = len(imported.outputs)
    theirs, ours = (
        values.reshape(count, _POINTS, _POINTS)
        for values in (imported.surface(*mesh), table.at(*mesh))
    )
    with rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(12.0, 0.6 + 3.3 * count), layout="constrained")
        axes = figure.subplots(count, 3, squeeze=False, sharex=True, sharey=True)
        for row, name, file, law in zip(axes, imported.outputs, theirs, ours, strict=True):
            lowest, highest = (f(np.stack([file, law])) for f in (np.min, np.max))
            for plot, values, text in zip(
                row,
                (file, law, law - file),
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
                (table.error_peaks, row[1].axvline),
                (table.rate_peaks, row[1].axhline),
            ):
                for at in lines if len(lines) <= _TICKS else ():
                    draw_line(at, color="white", linewidth=0.7, alpha=0.7)
            row[0].set(ylabel="e_dot, rad/s")
        for plot in axes[-1]:
            plot.set(xlabel="e, rad")
        figure.suptitle(title)
    return figure
