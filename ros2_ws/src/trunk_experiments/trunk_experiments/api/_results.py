"""What is concluded from runs: `Metrics`, `Verification`, `Picture`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal, cast

from trunk_msgs_util.text import printable

from ..analysis import metrics as analysis
from ..errors import PlanError
from ._run import Run, run_of
from ._values import AnyPath, html_table, output_path, path_of, text_table, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Metrics(analysis.RunMetrics):
    """Quantities of the true error ``e = reference - theta``; None where a run has no such value.

        overshoot_deg                  beyond the last level of the reference       deg
        settling_time_6deg_s           until |e| stays within 6 deg                s
        steady_state_error_mean_deg,
        steady_state_error_rms_deg     of e over the last 2 s                       deg
        iae, ise, itae                 integrals of |e|, e^2, t |e|                 rad s, rad^2 s, rad s^2
        effort                         integral of the squared torque               N^2 m^2 s
        peak_torque                    largest magnitude of the torque              N m
        theta_min_deg, theta_max_deg   smallest and largest angle                   deg

    Made by `metrics`. ``as_dict()`` returns them by name; ``print`` shows a table with units.
    """

    def _rows(self) -> list[tuple[str, str, str]]:
        values = self.as_dict()
        return [
            (q.label, q.missing if values[key] is None else f"{values[key]:.6g}", q.unit)
            for key, q in analysis.QUANTITIES.items()
        ]

    def __str__(self) -> str:
        return text_table(self._rows())

    def _repr_html_(self) -> str:
        return html_table("Metrics", ("quantity", "value", "unit"), self._rows())


def metrics(run: Run | AnyPath) -> Metrics:
    """Return the metrics of a `Run`, or of the recording at a path.

    Raises RecordingError if it cannot be read, or has no true states or no reference.
    """
    from ..analysis.run_table import recorded_metrics

    values = recorded_metrics(run_of(run)._recorded)
    return Metrics(*(getattr(values, field.name) for field in fields(values)))


Word = Literal["verified", "diverges", "inconclusive", "not signed"]


@dataclass(frozen=True)
class CheckedPart:
    """One kind of recomputation: ``steps`` were recomputed, and ``diverging`` of them differ.

    Made by `verify`. ``first``: the first difference, with topic, stamp, both values, and distance in ULPs.
    """

    name: str
    steps: int
    diverging: int
    first: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Verification:
    """What recomputing a recording found.

    Made by `verify`. ``verdict``: ``verified``, ``diverges``, ``inconclusive`` or ``not signed``.
    ``judged``: which part of the run was judged, in words. ``checked``: what was recomputed. ``reasons``: why
    it is not verified, one line each; empty if it is. ``not_judged``: what no check covers. ``notes``: what
    else there is to know, such as a signature.
    """

    verdict: Word
    judged: str
    checked: tuple[CheckedPart, ...]
    reasons: tuple[str, ...]
    not_judged: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def verified(self) -> bool:
        """True if every command and, where time was exact, every state follows, bit by bit."""
        return self.verdict == "verified"

    @property
    def steps(self) -> int:
        """How many steps were recomputed, of all kinds."""
        return sum(check.steps for check in self.checked)

    def __repr__(self) -> str:
        summary = [self.verdict, *([self.judged] if self.judged else []), *self.reasons]
        return printable(f"Verification({'; '.join(summary)})")

    def _repr_html_(self) -> str:
        rows: list[tuple[str, str]] = [("judged", self.judged)] if self.judged else []
        rows += [
            (check.name, f"{check.steps} steps, {check.diverging or 'none'} diverging")
            for check in self.checked
        ]
        rows += [("reason", line) for line in self.reasons]
        rows += [("not judged", line) for line in self.not_judged]
        rows += [("note", line) for line in self.notes]
        return html_table(f"Verification: {self.verdict}", ("", ""), rows)


def verify(run: Run | AnyPath, *, key: AnyPath | None = None) -> Verification:
    """Recompute every command of a recording and, where time was exact, every state.

    ``key``: the file of the public Ed25519 key that must have signed it; None: any
    signature beside the recording counts, whoever made it.

    Raises RecordingError for a recording that cannot be read, and another `TrunkError` for an invalid key.
    """
    from ..replay.signing import judge_signature, public_key
    from ..replay.verify import describe, verdict_on

    file = None if key is None else path_of(key, "key")
    trusted = None if file is None else public_key(file)
    recorded = run_of(run)._recorded
    verdict = verdict_on(recorded)
    judge_signature(verdict, recorded.recording, trusted, str(file))
    return Verification(
        cast("Word", verdict.word),
        verdict.judged,
        tuple(
            CheckedPart(
                part.name,
                part.steps,
                part.wrong_steps,
                tuple(describe(step) for step in part.first),
            )
            for part in verdict.checks
        ),
        tuple(verdict.reasons),
        tuple(verdict.unjudged),
        tuple(verdict.notes),
    )


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
    from ..views.report import make_report
    from ..views.report_page import write
    from ..views.run_view import RunView

    if not runs:
        raise PlanError("report: no run: give at least one")
    opened = [run_of(run)._recorded for run in runs]
    target = output_path(output, (".html", ".htm"), overwrite, [run.path for run in opened])
    page = make_report([RunView.read(run) for run in opened])
    with writing(target):
        write(page, target)
