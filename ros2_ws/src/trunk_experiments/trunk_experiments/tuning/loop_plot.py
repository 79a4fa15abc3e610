"""Sampled loops as a control engineer draws them: Bode, Nyquist, root locus, step of the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..views.plots import COLORS, STYLE
from .linear import LinearLoop
from .margins import LoopMargins

_FACTORS = np.geomspace(0.05, 20.0, 300)  # of all gains, in the root locus
_STEP_S = 3.0  # shown of the step
_DASHES: dict[str, Any] = {"prescribed": "solid", "passive": (0, (5, 2))}


def draw(rows: Sequence[LoopMargins], title: str) -> Figure:
    """Return a figure of the loops: a colour for each controller, dashed with a passive hip."""
    colors = {at: COLORS[k % len(COLORS)] for k, at in enumerate(dict.fromkeys(r.at for r in rows))}
    with rc_context(STYLE):
        figure = Figure(figsize=(12.0, 8.0), layout="constrained")
        axes = figure.subplot_mosaic(
            [["magnitude", "nyquist"], ["phase", "nyquist"], ["step", "locus"], ["step", "locus"]]
        )
        axes["magnitude"].sharex(axes["phase"])
        for row in rows:
            style: dict[str, Any] = {"color": colors[row.at], "linestyle": _DASHES[row.hip]}
            _bode(axes["magnitude"], axes["phase"], row.loop, style)
            response = row.loop.response(row.loop.frequencies())
            axes["nyquist"].plot(response.real, response.imag, **style)
            _root_locus(axes["locus"], row.loop, colors[row.at])
            label = f"{row.at}, hip {row.hip}" + ("" if row.margins else ": UNSTABLE")
            angles = row.loop.step_response(int(_STEP_S / row.loop.h))
            times = np.arange(len(angles)) * row.loop.h
            axes["step"].plot(times, np.clip(angles, -3.0, 3.0), label=label, **style)
        _dress(axes)
        handles, labels = axes["step"].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4))
        figure.suptitle(title)
    return figure


def _bode(magnitude: Axes, phase: Axes, loop: LinearLoop, style: dict[str, Any]) -> None:
    frequency = loop.frequencies()
    response = loop.response(frequency)
    degrees = np.degrees(np.unwrap(np.angle(response)))
    # Whole turns are arbitrary: at high frequencies a lag is shown below 0.
    crossing = int(np.argmin(np.abs(np.log(np.abs(response)))))
    magnitude.loglog(frequency, np.abs(response), **style)
    phase.semilogx(frequency, degrees - 360.0 * np.ceil(degrees[crossing] / 360.0), **style)


def _root_locus(plot: Axes, loop: LinearLoop, color: str) -> None:
    roots = [np.linalg.eigvals(replace(loop, factor=float(f)).matrix()) for f in _FACTORS]
    for points, marker, size in (
        (np.concatenate(roots), ".", 1.5),
        (np.linalg.eigvals(loop.matrix()), "x", 8.0),
    ):
        s = np.log(points[np.abs(points) > 1e-6].astype(complex)) / loop.h
        plot.plot(s.real, s.imag, marker, color=color, markersize=size)


def _dress(axes: dict[str, Axes]) -> None:
    axes["magnitude"].axhline(1.0, color="black", linewidth=0.8)
    axes["magnitude"].set(
        ylabel="|L|", ylim=(1e-2, 1e2), title="Bode: open loop, cut at the torque"
    )
    axes["magnitude"].tick_params(labelbottom=False)
    axes["phase"].axhline(-180.0, color="black", linewidth=0.8)
    axes["phase"].set(xlabel="frequency, rad/s", ylabel="phase of L, °", xlim=(0.1, None))
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    axes["nyquist"].plot(np.cos(angle), np.sin(angle), color="gray", linewidth=0.8)
    axes["nyquist"].plot([-1.0], [0.0], "+", color="black", markersize=12)
    axes["nyquist"].set_aspect("equal", adjustable="box")
    axes["nyquist"].set(
        xlim=(-8.0, 2.0), ylim=(-4.0, 4.0), xlabel="Re L", ylabel="Im L",
        title="Nyquist: the loop is stable if L goes once around −1",
    )  # fmt: skip
    axes["locus"].axvline(0.0, color="black", linewidth=0.8)
    axes["locus"].set(
        xlim=(-60.0, 15.0), ylim=(-30.0, 30.0), xlabel="Re s, 1/s", ylabel="Im s, rad/s",
        title="Root locus, s = ln z / h: 0.05 to 20 times the gains; × as they are",
    )  # fmt: skip
    axes["step"].set(
        xlabel="time, s",
        ylabel="angle / reference",
        ylim=(-0.5, 2.0),
        title="Step of the reference",
    )
