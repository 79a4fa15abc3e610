"""What is concluded from runs: their metrics, whether they verify, pictures and reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..analysis.metrics import Metrics
from ..errors import PlanError
from ..replay.verdict import Verification
from ._run import Run, run_of
from ._values import AnyPath, output_path, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def metrics(run: Run | AnyPath) -> Metrics:
    """Return the metrics of a `Run`, or of the recording at a path.

    Raises RecordingError if it cannot be read, or has no true states or no reference.
    """
    from ..analysis.run_table import recorded_metrics

    return recorded_metrics(run_of(run)._recorded)


def verify(run: Run | AnyPath) -> Verification:
    """Recompute every command of a recording and, where time was exact, every state.

    Raises RecordingError for a recording that cannot be read.
    """
    from ..replay.verdict import verification
    from ..replay.verify import verdict_on

    recorded = run_of(run)._recorded
    return verification(recorded, verdict_on(recorded))


_SUFFIXES = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class Picture:
    """A drawing; a notebook shows it. Made by `plot` and `Sweep.map`.

    ``figure``: the Matplotlib figure, to change or add to.
    """

    figure: Figure

    def save(self, path: AnyPath, *, overwrite: bool = False) -> None:
        """Write it as PNG, SVG or PDF, chosen by the path's suffix; the same runs give the same bytes.

        Raises PlanError for any other suffix, and for a file that exists, unless ``overwrite``.
        """
        from ..views.plots import save

        target = output_path(path, _SUFFIXES, overwrite)
        with writing(target):
            save(self.figure, target)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the picture, and its width in CSS pixels, 96 to the inch."""
        from ..views.plots import drawn

        return drawn(self.figure, ".png"), {"width": round(96 * self.figure.get_figwidth())}


def plot(
    *runs: Run | AnyPath, fig: int | None = None, names: Sequence[str] | None = None
) -> Picture:
    """Draw one run, or several overlaid: `Run` objects, or paths of recordings.

    ``fig``: lay it out like figure 6, 7, 8 or 9 of the paper (angles over time); None: angle, torque, gains,
    path and phase. ``names``: the runs' names in the legend, one for each run.

    Raises PlanError if there is no run, for any other figure and for a wrong number of names, and
    RecordingError for a recording that cannot be read.
    """
    from ..views.plots import FIGURES, overview, paper_figure
    from ..views.run_view import RunView

    if not runs:
        raise PlanError("plot: no run: give at least one")
    if fig is not None and fig not in FIGURES:
        raise PlanError(f"plot: fig is {fig!r}: one of {', '.join(map(str, FIGURES))} is needed")
    if names is not None and (not isinstance(names, list | tuple) or len(names) != len(runs)):
        raise PlanError(f"plot: names {names!r}: give a list of {len(runs)}, one for each run")
    views = [RunView.read(run_of(run)._recorded) for run in runs]
    labels = None if names is None else [str(name) for name in names]
    return Picture(overview(views, labels) if fig is None else paper_figure(views, fig, labels))


def report(*runs: Run | AnyPath, output: AnyPath, overwrite: bool = False) -> None:
    """Write runs as one HTML page that needs no network: animated, plotted, judged, as `trunk report` does.

    Raises PlanError if there is no run and for an output that cannot be written, and RecordingError for a
    recording that cannot be read.
    """
    from ..views.report import make_report, write
    from ..views.run_view import RunView

    if not runs:
        raise PlanError("report: no run: give at least one")
    opened = [run_of(run)._recorded for run in runs]
    target = output_path(output, (".html", ".htm"), overwrite, [run.path for run in opened])
    page = make_report([RunView.read(run) for run in opened])
    with writing(target):
        write(page, target)
