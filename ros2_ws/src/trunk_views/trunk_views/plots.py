"""Runs as printed pictures: an overview of everything, or the layout of one of the paper's figures.

Drawn only on `matplotlib.figure.Figure`: no window, no global state, whatever the environment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from io import BytesIO
from math import isfinite, nan
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import rc_context, rcParamsDefault
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from trunk_core.errors import PlanError
from trunk_core.files import atomic_write
from trunk_core.units import seconds
from trunk_evidence.doubts import doubts_of
from trunk_evidence.evidence import Pulse
from trunk_evidence.run_metrics import SETTLING_BAND_DEG
from trunk_msgs_util.picture.frames import Track

from .run_view import (
    RunView,
    gains_told,
    labels,
    off_scale,
    on_tracks,
    own_terms,
    values_of_term,
    words_of,
)

if TYPE_CHECKING:
    from trunk_core.arrays import Floats

    from .run_view import RunView


# Okabe and Ito's colours without the yellow, distinct with any colour vision, and a violet; line styles that
# survive grey print.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#5E4FA2")
DASHES: tuple[Any, ...] = (
    "solid",
    (0, (6, 1.6)),
    (0, (6, 1.4, 1.2, 1.4)),
    (0, (1.2, 1.2)),
    (0, (9, 2, 3, 2)),
)
SUFFIXES: dict[str, dict[str, Any]] = {  # and what keeps the date out of the file
    ".png": {},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}
DPI = 150
STYLE = {  # all of it: a user's own settings, such as LaTeX for texts, change nothing
    **{key: value for key, value in rcParamsDefault.items() if not key.startswith("backend")},
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#444444",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "trunk",  # the same run gives the same file
    "svg.fonttype": "none",  # text stays text
    "pdf.fonttype": 42,
}


def with_unit(label: str, unit: str) -> str:
    """Return an axis' label: a quantity, and its unit in parentheses with dots between factors."""
    return f"{label} ({unit.replace(' ', '·')})" if unit else label


def line_style(index: int) -> dict[str, Any]:
    """Return colour and dashes of the i-th run; up to 8 x 5 runs look different."""
    return {
        "color": COLORS[index % len(COLORS)],
        "linestyle": DASHES[index % len(DASHES)],
    }


def save(figure: Figure, path: Path) -> None:
    """Write the picture in the format of the file's suffix; the same runs give the same bytes.

    Raises PlanError for a suffix other than png, svg or pdf.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise PlanError(f"{path}: a picture's name must end in one of {', '.join(SUFFIXES)}")
    picture = drawn(figure, suffix)  # matplotlib's writers do not say what went wrong with a file
    with atomic_write(path) as part:
        part.write_bytes(picture)


def drawn(figure: Figure, suffix: str, dpi: int = DPI) -> bytes:
    """Return the picture in the format of one of `SUFFIXES`."""
    picture = BytesIO()
    with rc_context(STYLE):
        figure.savefig(
            picture, format=suffix[1:], dpi=dpi, metadata=SUFFIXES[suffix], facecolor="white"
        )
    return picture.getvalue()


BAND, PULSE, REFERENCE, LIMIT = "#7a7a7a", "#E69F00", "#222222", "#B00020"
TURN = "#555555"
TURN_LINE: dict[str, Any] = {"color": TURN, "linewidth": 1.0, "linestyle": (0, (5, 2, 1, 2))}
BRANCH = "#0072B2"
BRANCH_LINE: dict[str, Any] = {"color": BRANCH, "linewidth": 1.4, "linestyle": (0, (6, 2))}
FALL_LINE: dict[str, Any] = {"color": "#444444", "linewidth": 1.0, "linestyle": (0, (1, 1))}
_COLUMNS = 5  # of the legend: more are wider than the figure
_NAMED_TURNS = 6  # more would overlap
_LONG_PATH = 20_000  # rows
_CELLS_OF_PATH = 800  # on each side of a picture


def with_doubts(name: str, view: RunView) -> str:
    """Return a run's name for the legend, with what makes it doubtful."""
    doubts = doubts_of(view.run, twin=False)
    late = doubts.late
    behind = f"{late.steps} of {late.of} steps late" if late and late.steps else ""
    words = [
        "silent" * bool(doubts.silent),
        "incomplete" * (not doubts.complete),
        "fell" * (doubts.fell is not None),
        behind,
        "not judged" * bool(doubts.not_judged),
    ]
    notes = ", ".join(filter(None, words))
    return f"{name} ({notes})" if notes else name


def run_handles(names: Sequence[str]) -> list[Line2D | Patch]:
    """Return the legend's entries of the runs."""
    return [Line2D([], [], **line_style(i), label=plain(name)) for i, name in enumerate(names)]


def context_handles(views: Sequence[RunView], limits: bool) -> list[Line2D | Patch]:
    """Return the legend's entries other than runs: the reference, its band, pulses, limits."""
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=REFERENCE, linewidth=1.0, linestyle=(0, (2, 2)), label="reference"),
        Patch(color=BAND, alpha=0.22, linewidth=0, label=f"reference ±{SETTLING_BAND_DEG:g}°"),
    ]
    shared, own = _pulses(views)
    if shared:
        handles.append(Patch(color=PULSE, alpha=0.45, linewidth=0, label="pulse acts"))
    if own:
        color = line_style(own[0][0])["color"]
        handles.append(
            Patch(color=color, alpha=0.25, linewidth=0, label="on one run, in its colour")
        )
    if any(len(view.turns) > 1 for view in views):
        handles.append(Line2D([], [], label="another controller takes over", **TURN_LINE))
    if any(view.run.fall for view in views):
        handles.append(Line2D([], [], label="fell, in the run's colour", **FALL_LINE))
    if any(view.run.branch for view in views):
        handles.append(Line2D([], [], label="a branch begins", **BRANCH_LINE))
    if limits:
        handles.append(
            Line2D([], [], color=LIMIT, linewidth=1.0, label=words_of(views)("torque limits"))
        )
    return handles


def legend(
    figure: Figure, where: str, runs: list[Line2D | Patch], context: list[Line2D | Patch]
) -> None:
    """Add a legend outside all axes: rows of runs, then of everything else, as wide as the figure at most."""
    most = min(max(min(4, len(runs)), len(context)), _COLUMNS)
    groups = [runs, context]
    if len(runs) == 1 and len(context) < _COLUMNS:
        groups, most = [runs + context], 1 + len(context)
    blank = Line2D([], [], alpha=0.0, label=" ")
    for columns in range(most, 0, -1):
        rows = [group[i : i + columns] for group in groups for i in range(0, len(group), columns)]
        filled = [row + [blank] * (columns - len(row)) for row in rows]
        # Matplotlib fills column by column.
        handles = [row[i] for i in range(columns) for row in filled]
        drawn = figure.legend(handles=handles, loc=where, ncols=columns)
        if columns == 1 or drawn.get_window_extent().width <= figure.bbox.width:
            return
        drawn.remove()


def plain(text: str) -> str:
    """Return a name that Matplotlib neither reads as mathematics nor (``_…``) leaves out."""
    return text.replace("$", r"\$") if not text.startswith("_") else f" {text}".replace("$", r"\$")


def _pulses(views: Sequence[RunView]) -> tuple[list[Pulse], list[tuple[int, Pulse]]]:
    """Return the pulses that act on all runs, and each other one with the index of its run."""
    shared = set.intersection(*(set(view.pulses) for view in views))
    own = [(i, pulse) for i, view in enumerate(views) for pulse in sorted({*view.pulses} - shared)]
    return sorted(shared), own


def pulse_spans(axes: Axes, views: Sequence[RunView]) -> None:
    """Mark where pulses act; in a run's colour where they act on it, and not on all."""
    shared, own = _pulses(views)
    for p in shared:
        axes.axvspan(p.start, p.end, color=PULSE, alpha=0.45, linewidth=0, zorder=0.5)
    for i, p in own:
        color = line_style(i)["color"]
        axes.axvspan(p.start, p.end, color=color, alpha=0.25, linewidth=0, zorder=0.5)


def turns(axes: Axes, views: Sequence[RunView], named: bool = False) -> None:
    """Mark where another controller takes over; ``named``: say which, if there is one run."""
    for start in sorted({turn.start for view in views for turn in view.turns[1:]}):
        axes.axvline(start, zorder=1.0, **TURN_LINE)
    acted = views[0].turns if named and len(views) == 1 else ()
    for turn in acted if 1 < len(acted) <= _NAMED_TURNS else ():
        axes.annotate(
            plain(turn.controller),
            (turn.start, 0.1),
            xycoords=("data", "axes fraction"),
            xytext=(4, 0),
            textcoords="offset points",
            fontsize=8.0,
            color=TURN,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
        )


def branches(axes: Axes, views: Sequence[RunView]) -> None:
    """Mark where branches begin: up to there they equal their parent."""
    for start in sorted({view.run.branch.at for view in views if view.run.branch}):
        axes.axvline(start, zorder=1.1, **BRANCH_LINE)


def falls(axes: Axes, views: Sequence[RunView]) -> None:
    """Mark where each run's trunk fell, in the run's own colour; the legend says so, clear of the curves."""
    for i, view in enumerate(views):
        if (fall := view.run.fall) is not None:
            axes.axvline(seconds(fall.stamp_ns), **{**FALL_LINE, "color": line_style(i)["color"]})


class Panel(NamedTuple):
    """A small panel over time: of a gain, or of a law's own term."""

    title: str
    label: str
    values: Callable[[RunView], Floats]


def _gain(title: str, symbol: str, unit: str, column: str) -> Panel:
    return Panel(f"{title} {symbol}", f"{symbol} ({unit})", attrgetter(f"table.{column}"))


_GAINS = (
    _gain("Gain", r"$K_p$", "N·m/rad", "kp"),
    _gain("Gain", r"$K_i$", "N·m/(rad·s)", "ki"),
    _gain("Gain", r"$K_d$", "N·m·s/rad", "kd"),
    _gain("Ratio", r"$\alpha$", "no unit", "alpha"),
)


def panels_of(views: Sequence[RunView]) -> Sequence[Panel]:
    """Return the gains' panels; for laws that tell none, those of up to four of their own terms."""
    if gains_told(views):
        return _GAINS
    return [
        Panel(term.name.replace("_", " "), term.title, partial(values_of_term, term=term))
        for term in own_terms(views)[:4]
    ]


_FAR = 1e12  # m: sine has no digits left there; rad: an axis has none
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
        top = torque.get_ylim()[1]  # bounds beyond are not seen
        limits = any(abs(bound) <= top for view in views for bound in view.limits)
        context = context_handles(views, limits)
        legend(figure, "outside upper center", run_handles(names), context)
    return in_words_of(figure, views)


def planes(views: Sequence[RunView]) -> Figure:
    """Return hip path and phase portrait of one run or several, side by side."""
    with rc_context(STYLE):
        figure = Figure(figsize=(10.0, 3.6), layout="constrained")
        path, phase = figure.subplots(1, 2)
        _path(path, views)
        _phase(phase, views)
    return in_words_of(figure, views)


def in_words_of(figure: Figure, views: Sequence[RunView]) -> Figure:
    """Return a figure whose axes speak of the runs' plant; runs keep their names."""
    words = words_of(views)
    for axes in figure.axes:
        axes.set_title(words(axes.get_title("left")), loc="left")
        axes.set_xlabel(words(axes.get_xlabel()))
        axes.set_ylabel(words(axes.get_ylabel()))
    return figure


def thinned_path(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a path in a plane without what a picture cannot show; a short one as it is.

    Of a long one, rows that stay within a cell are left out, and steps that the path has taken before.
    """
    if len(x) < _LONG_PATH:
        return x, y
    finite = np.isfinite(x) & np.isfinite(y)
    if not finite.all():
        x, y = x[finite], y[finite]
    if len(x) < _LONG_PATH:
        return x, y
    cell = np.zeros(len(x), np.int32)
    for v in (x, y):
        cell *= _CELLS_OF_PATH + 1
        cell += ((v - v.min()) / (np.ptp(v) or 1.0) * _CELLS_OF_PATH).astype(np.int32)
    moved = np.flatnonzero(np.diff(cell, prepend=-1))
    step = np.append(-1, cell[moved[:-1]]) * (_CELLS_OF_PATH + 1) ** 2 + cell[moved]
    new = np.zeros(len(moved), bool)
    new[np.unique(step, return_index=True)[1]] = True
    kept = np.flatnonzero(new | np.append(new[1:], False))  # a step's beginning, and its end
    at = np.insert(moved[kept], np.flatnonzero(np.diff(kept) > 1) + 1, -1)
    return np.where(at < 0, nan, x[at]), np.where(at < 0, nan, y[at])


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
    return in_words_of(figure, views)


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
    held = "Trunk angle" if _alike(views) else "Angle"
    axes.set_title(held if _any_of_ours(views) else "Angle, as measured")
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
    plant = views[0].plant if _alike(views) else None
    driven = "Effort" if plant is None else f"Torque on the {('hip', 'trunk')[plant.drive]}"
    axes.set_title(driven if _any_of_ours(views) else "Torque, as commanded")
    axes.set_ylabel(r"torque $\tau$ (N·m)" if _alike(views) else r"effort $\tau$")
    spans = [off_scale(view.table.torque) for view in views]
    wanted = [
        _peak(view) if span is None else span for view, span in zip(views, spans, strict=True)
    ]
    if any(span is not None for span in spans):
        limit = max(wanted)
        axes.set_ylim(-limit, limit)
        peak = max(_peak(view) for view in views)
        axes.set_title(
            words_of(views)(f"off scale: short peaks up to {peak:,.0f} N·m"),
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
    ours = [(i, view) for i, view in enumerate(views) if view.pictured]
    if not ours:
        unknown = views[0].unknown_plant
        _say(axes, f"{unknown or 'another robot'}:\nits picture is not known here")
        return
    if not on_tracks(views):
        _phase(axes, views, "x")
        return
    tracks = [view.geometry.picture.track or Track() for _, view in ours]
    ranges = [_travelled(view) for _, view in ours]
    low, high = min(low for low, _ in ranges), max(high for _, high in ranges)
    margin = 0.25 * max(high - low, 1.0)
    x = np.linspace(low - margin, high + margin, 800)
    for track in dict.fromkeys(tracks):
        axes.plot(x, [track.height(at) for at in x.tolist()], color="#888888", linewidth=0.9)
    for (i, view), track, (least, most) in zip(ours, tracks, ranges, strict=True):
        traveled = np.linspace(least, most, 800)
        y = [track.height(at) for at in traveled.tolist()]
        # Wide below, narrow above: every run's range shows even where they overlap.
        width = 2.2 + 2.4 * (len(views) - 1 - i)
        color = COLORS[i % len(COLORS)]
        axes.plot(traveled, y, color=color, linewidth=width, solid_capstyle="butt")
        start = [_height(view, track)]
        axes.plot(view.table.x[:1], start, "o", color="#222222", markersize=5, zorder=5)
    axes.annotate(
        "start",
        (float(ours[0][1].table.x[0]), _height(ours[0][1], tracks[0])),
        xytext=(8, -9),
        textcoords="offset points",
        fontsize=8.0,
    )
    axes.set_title("Hip path, travelled range in colour")
    axes.set_xlabel(r"$x$ (m)")
    sine = all(track.harmonics is None for track in tracks)
    level = any(track.amplitude == 0.0 for track in tracks)
    axes.set_ylabel(r"$y = A\,\sin(k x)$ (m)" if sine and not level else r"$y$ (m)")
    if high - low < 20.0:  # the path of a runaway hip is too long to be drawn to scale
        axes.set_aspect("equal", adjustable="datalim")


def _travelled(view: RunView) -> tuple[float, float]:
    """Return the range of the hip's finite positions in m; 0 and 0 without any."""
    x = view.table.x[np.isfinite(view.table.x) & (np.abs(view.table.x) < _FAR)]
    return (float(x.min()), float(x.max())) if len(x) else (0.0, 0.0)


def _height(view: RunView, track: Track) -> float:
    x = float(view.table.x[0])
    return track.height(x) if abs(x) < _FAR else nan


def _alike(views: Sequence[RunView]) -> bool:
    plants = {view.plant for view in views}
    return len(plants) == 1 and None not in plants


def _any_of_ours(views: Sequence[RunView]) -> bool:
    return not all(view.run.another_robot for view in views)


def _say(axes: Axes, text: str) -> None:
    """Write a text in place of a plot."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)


def _phase(axes: Axes, views: Sequence[RunView], angle: str = "theta") -> None:
    """Draw an angle's rate over it: of the second coordinate, or of ``x`` where that is an angle."""
    if all(np.isnan(getattr(view.table, f"{angle}_dot")).all() for view in views):
        _say(axes, "no velocities were measured")
        return
    for i, view in enumerate(views):
        theta, rate = (
            np.where(np.abs(v) < _FAR, v, nan)
            for v in (getattr(view.table, name) for name in (angle, f"{angle}_dot"))
        )
        theta = np.degrees(theta)
        axes.plot(*thinned_path(theta, rate), **line_style(i), linewidth=1.0)
        axes.plot(theta[:1], rate[:1], "o", color="#222222", markersize=5, zorder=5)
        axes.plot(theta[-1:], rate[-1:], "s", color=line_style(i)["color"], markersize=5, zorder=5)
    axes.set_title("Phase portrait (● start, ■ end)")
    symbol = r"\theta" if angle == "theta" else "x"
    axes.set_xlabel(rf"angle ${symbol}$ (°)")
    axes.set_ylabel(rf"rate $\dot{{{symbol}}}$ (rad/s)")
