"""What plots share: the legend, with what makes a run doubtful, and marks of pulses, turns and falls."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from trunk_msgs_util.units import seconds

from ..analysis.metrics import SETTLING_BAND_DEG
from ..replay.doubts import doubts_of
from .plot_style import line_style
from .run_view import Pulse, RunView

BAND, PULSE, REFERENCE, LIMIT = "#7a7a7a", "#E69F00", "#222222", "#B00020"
TURN = "#555555"
TURN_LINE: dict[str, Any] = {"color": TURN, "linewidth": 1.0, "linestyle": (0, (5, 2, 1, 2))}
BRANCH = "#0072B2"
BRANCH_LINE: dict[str, Any] = {"color": BRANCH, "linewidth": 1.4, "linestyle": (0, (6, 2))}
_COLUMNS = 5  # of the legend: more are wider than the figure
_NAMED_TURNS = 6  # more would overlap


def with_doubts(name: str, view: RunView) -> str:
    """Return a run's name for the legend, with what makes it doubtful."""
    doubts = doubts_of(view.run, twin=False)
    late = f"{doubts.late} of {doubts.steps} steps late" if doubts.late else ""
    words = [
        "silent" * bool(doubts.silent),
        "incomplete" * bool(doubts.incomplete),
        "fell" * (doubts.fell_at_s is not None),
        late,
    ]
    notes = ", ".join(filter(None, words))
    return f"{name} ({notes})" if notes else name


def run_handles(names: Sequence[str]) -> list[Line2D | Patch]:
    """Return the legend's entries of the runs."""
    return [Line2D([], [], **line_style(i), label=plain(name)) for i, name in enumerate(names)]


def context_handles(views: Sequence[RunView], limits: bool = True) -> list[Line2D | Patch]:
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
    if any(view.run.branch for view in views):
        handles.append(Line2D([], [], label="a branch begins", **BRANCH_LINE))
    if limits and any(isfinite(bound) for view in views for bound in view.limits):
        handles.append(Line2D([], [], color=LIMIT, linewidth=1.0, label="torque limits"))
    return handles


def legend(
    figure: Figure, where: str, runs: list[Line2D | Patch], context: list[Line2D | Patch]
) -> None:
    """Add a legend outside all axes: rows of runs, then a row of everything else."""
    columns = min(max(min(4, len(runs)), len(context)), _COLUMNS)
    groups = [runs, context]
    if len(runs) == 1 and len(context) < _COLUMNS:
        groups, columns = [runs + context], 1 + len(context)
    rows = [group[i : i + columns] for group in groups for i in range(0, len(group), columns)]
    blank = Line2D([], [], alpha=0.0, label=" ")
    filled = [row + [blank] * (columns - len(row)) for row in rows]
    # Matplotlib fills column by column.
    handles = [row[i] for i in range(columns) for row in filled]
    figure.legend(handles=handles, loc=where, ncols=columns)


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
    """Mark where each run's trunk fell, in the run's own colour."""
    for i, view in enumerate(views):
        fell_ns = view.recording.fell_at_ns
        if fell_ns is None:
            continue
        style = line_style(i)
        axes.axvline(seconds(fell_ns), color=style["color"], linewidth=1.0, linestyle=(0, (1, 1)))
        axes.annotate(
            "fell",
            (seconds(fell_ns), 0.94 - 0.08 * (i % 8)),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=8.0,
            color=style["color"],
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.0},
            zorder=6.0,
        )
