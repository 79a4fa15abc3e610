"""`Plan`: what decides a run; `Run`: a recorded run as arrays, where runs come from, what is concluded."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from trunk_core.errors import PlanError, RecordingError, did_you_mean
from trunk_core.parameters.declarations import ParameterError, Value, values_of
from trunk_core.results import html_table
from trunk_core.text import printable
from trunk_evidence.run_metrics import Metrics
from trunk_evidence.verdict import Verification
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.plan import RunPlan, Swap, make_plan

from ._values import (
    COLUMNS,
    AnyPath,
    frame,
    keyed,
    layers_of,
    mapping_of,
    names_of,
    number_of,
    output_path,
    path_of,
    plain,
    writing,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from trunk_core.arrays import Floats
    from trunk_evidence.parameter_text import ChangedParameter
    from trunk_evidence.recorded_run import RecordedRun
    from trunk_evidence.run_table import RunTable

_SUFFIXES = (".png", ".svg", ".pdf")


@dataclass(frozen=True, repr=False)
class Plan:
    """Everything that decides a run: all parameters of all nodes, and whose turn it is when.

    Made by `plan` and `Run.plan`.
    """

    _plan: RunPlan

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return self._plan.scenario

    @property
    def controllers(self) -> tuple[str, ...]:
        """The controllers, in the order of their first turns."""
        return tuple(self._plan.controllers)

    @property
    def duration(self) -> float:
        """Simulated time in s; 0: no end, which `simulate` refuses."""
        return self._plan.simulator.duration

    @property
    def rate(self) -> float:
        """Rate of the plant's steps in Hz: a run has ``duration * rate + 1`` states."""
        return self._plan.simulator.update_rate

    @property
    def parameters(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's parameters by name, in SI units and radians; for the units: `parameters`."""
        nodes = {name: values_of(config) for name, config in self._plan.configs.items()}
        return keyed(nodes)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was most likely not intended, one line each."""
        return self._plan.warnings

    def save(self, path: AnyPath, *, overwrite: bool = False) -> None:
        """Write all parameters as one ROS 2 parameter file, for nodes that are started elsewhere.

        Raises PlanError for a file that exists, unless ``overwrite``, or a name not ending in
        ``.yaml`` or ``.yml``.
        """
        target = output_path(path, (".yaml", ".yml"), overwrite)
        with writing(target):
            self._plan.write_parameters(target)

    def _facts(self) -> dict[str, str]:
        facts = {
            "scenario": self.scenario,
            "controllers": ", ".join(self.controllers),
            "duration": f"{self.duration:g} s",
            "rate": f"{self.rate:g} Hz",
        }
        return facts | {f"warning {i}": text for i, text in enumerate(self.warnings, 1)}

    def __repr__(self) -> str:
        summary = f"{self.scenario}, {', '.join(self.controllers)}, {self.duration:g} s at {self.rate:g} Hz"
        return printable(f"Plan({'; '.join((summary, *self.warnings))})")

    def _repr_html_(self) -> str:
        return html_table("Plan", ("", ""), self._facts().items())


def plan(
    scenario: AnyPath,
    controller: str = "fuzzy_pid",
    *,
    params: AnyPath | Sequence[AnyPath] = (),
    overrides: Mapping[str, Any] = MappingProxyType({}),
    duration: float | None = None,
    rate: float | None = None,
    swaps: Sequence[tuple[float, str]] = (),
    pushes: Sequence[str] = (),
) -> Plan:
    """Return the plan of a run; all files are read and all values checked.

    ``scenario``: one of `scenarios`, or a parameter file's path.
    ``controller``: one of `controllers`.
    ``params``: parameter files on top, by path or one of `parameter_files`; later ones win.
    ``overrides``: single values by ``"NODE.PARAM"``, in SI units and radians; they win over all files.
    For an array, give a sequence or a NumPy array.
    ``duration``: simulated time in s. ``rate``: of simulator and controllers in Hz.
    ``swaps``: pairs of a time in s and the controller that takes over then, in ascending order.
    ``pushes``: pulses besides the scenario's, as `trunk simulate --push` takes them: ``"60Nm:0.1s@3"``.

    Raises PlanError, ParameterError or another `TrunkError`: one line with the name, its value, and what is
    allowed.
    """
    turns = _swaps(swaps)
    acting = [str(controller), *(turn.controller for turn in turns)]
    everywhere = {
        name: value
        for name, value in (
            ("duration", number_of(duration, "duration")),
            ("update_rate", number_of(rate, "rate")),
        )
        if value is not None
    }
    made = make_plan(
        str(path_of(scenario, "scenario")),
        str(controller),
        names_of(params, "params"),
        layers_of(overrides, acting),
        everywhere,
        swaps=turns,
        pushes=list(names_of(pushes, "pushes")),
    )
    return Plan(made)


def _swaps(swaps: Any) -> list[Swap]:
    """Return the swaps. Raises PlanError unless they are a list or tuple of swaps."""
    if not isinstance(swaps, list | tuple):
        raise PlanError(f"swaps {swaps!r}: a list is needed, such as [(4.0, 'pid')]")
    return [_swap(swap) for swap in swaps]


def _swap(pair: Any) -> Swap:
    """Return a swap. Raises PlanError unless it is a time and a controller's name."""
    time, name = pair if isinstance(pair, tuple | list) and len(pair) == 2 else (None, None)
    time = number_of(time, "swaps: time")
    if not isinstance(time, int | float) or not isfinite(time) or name not in CONTROLLERS:
        raise PlanError(
            f"swaps: {pair!r}: a time in s and a controller are needed, such as (4.0, 'pid'); controllers: "
            f"{', '.join(CONTROLLERS)}{did_you_mean(str(name), CONTROLLERS)}"
        )
    return Swap(float(time), name)


@dataclass(frozen=True, repr=False, eq=False)
class Run:
    """A recorded run. Arrays [N + 1] have a row for each true state; NaN where the run has no value.

    Made by `load` and `simulate`. Each part of the file is read on first use; the arrays are read-only.
    Reading a part raises RecordingError for messages that cannot be read.
    """

    _recorded: RecordedRun
    _temporary: bool = False

    @cached_property
    def _table(self) -> RunTable:
        from trunk_evidence.run_table import RunTable

        table = RunTable.of_run(self._recorded)
        for name in COLUMNS:
            getattr(table, name).flags.writeable = False
        return table

    def __reduce__(self) -> tuple[Callable[[AnyPath], Run], tuple[AnyPath]]:
        """Pickle a run by its path. Raises PlanError for one whose file is deleted with the `Run`."""
        if self._temporary:
            raise PlanError(
                f"{self.path.name}: a temporary file, deleted with its run: to pass that to another process, "
                "record it to an output, or save it and load that"
            )
        return load, (self.path.absolute(),)

    def __copy__(self) -> Run:
        """Return the run, which does not change."""
        return self

    def __deepcopy__(self, memo: object) -> Run:
        """Return the run, which does not change."""
        return self

    @property
    def path(self) -> Path:
        """The recording; one that `simulate` made without an output lasts as long as the run."""
        return self._recorded.path

    @property
    def scenario(self) -> str:
        """The scenario's name; empty if it was not recorded."""
        return self._recorded.recording.provenance.get("scenario", "")

    @property
    def controllers(self) -> tuple[str, ...]:
        """The recorded controllers, in the order in which they first acted."""
        return tuple(self._recorded.controllers)

    @property
    def mode(self) -> str:
        """``offline``, ``lockstep`` or ``real_time``; empty if it was not recorded."""
        return self._recorded.mode

    @property
    def complete(self) -> bool:
        """True if the recording was finished."""
        return self._recorded.recording.complete

    @property
    def fell_at(self) -> float | None:
        """When the trunk fell, in s; None if it did not."""
        return self._doubts[1]

    @property
    def doubts(self) -> tuple[str, ...]:
        """What makes the numbers doubtful, one line each: SILENT, INCOMPLETE, FELL, NOT IN FORCE, LATE."""
        return self._doubts[0]

    @cached_property
    def _doubts(self) -> tuple[tuple[str, ...], float | None]:
        from trunk_evidence.doubts import doubts_of

        doubts = doubts_of(self._recorded, twin=False)
        return tuple(doubts.lines), doubts.fell

    @property
    def warnings(self) -> tuple[str, ...]:
        """What could not be read, one line each."""
        return tuple(self._recorded.recording.warnings)

    @property
    def parameters(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's parameters at the start, in SI units and radians."""
        return keyed(self._recorded.parameters)

    @property
    def changed(self) -> tuple[ChangedParameter, ...]:
        """The parameters that were changed while the run went on, by time."""
        from trunk_evidence.parameter_text import changed_parameters

        return tuple(changed_parameters(self._recorded))

    @property
    def provenance(self) -> Mapping[str, str]:
        """What made the recording: versions, commit, host, mode, time."""
        return keyed({"": self._recorded.recording.provenance})[""]

    @property
    def t(self) -> Floats:
        """Simulated time in s."""
        return self._table.t

    @property
    def x(self) -> Floats:
        """The hip's position in m, true."""
        return self._table.x

    @property
    def theta(self) -> Floats:
        """The trunk's angle from the vertical in rad, true."""
        return self._table.theta

    @property
    def x_dot(self) -> Floats:
        """The hip's velocity in m/s, true."""
        return self._table.x_dot

    @property
    def theta_dot(self) -> Floats:
        """The trunk's angular velocity in rad/s, true."""
        return self._table.theta_dot

    @property
    def theta_measured(self) -> Floats:
        """The angle in rad as the controller saw it: noise, bias, delay and pulses included."""
        return self._table.theta_measured

    @property
    def reference(self) -> Floats:
        """The desired angle in rad."""
        return self._table.reference

    @property
    def torque(self) -> Floats:
        """The torque on the trunk in N m, applied from ``t[k]`` to ``t[k + 1]``."""
        return self._table.torque

    @property
    def kp(self) -> Floats:
        """The gain on the angle's error in N m/rad, from the controller's last update."""
        return self._table.kp

    @property
    def ki(self) -> Floats:
        """The gain on the error's integral in N m/(rad s)."""
        return self._table.ki

    @property
    def kd(self) -> Floats:
        """The gain on the error's rate in N m s/rad."""
        return self._table.kd

    @property
    def alpha(self) -> Floats:
        """Kp^2 / (Ki Kd), without a unit, which Fuzzy-PID infers."""
        return self._table.alpha

    def __len__(self) -> int:
        """Return the number of true states, N + 1."""
        return len(self._table.t)

    @cached_property
    def _more(self) -> tuple[Mapping[str, Floats], Mapping[str, Floats]]:
        from trunk_evidence.run_table import disturbance, terms

        tables = terms(self._recorded, self._table), disturbance(self._recorded, self._table)
        for columns in tables:
            for column in columns.values():
                column.flags.writeable = False
        return tables

    @property
    def terms(self) -> Mapping[str, Floats]:
        """The law's own terms by name, such as ``p_term`` in N m, from its last update; gains are above."""
        return MappingProxyType(self._more[0])

    @property
    def disturbance(self) -> Mapping[str, Floats]:
        """What disturbs hip and trunk: ``disturbance_trunk_effort`` in N m, and the like for each channel."""
        return MappingProxyType(self._more[1])

    def arrays(self) -> dict[str, Floats]:
        """Return all columns by name, terms and disturbance too, each [N + 1]; `UNITS` has their units."""
        table = {name: getattr(self._table, name) for name in COLUMNS}
        return {**table, **self.terms, **self.disturbance}

    def frame(self) -> pd.DataFrame:
        """Return all columns as a pandas DataFrame [N + 1] with the index ``t``; units in ``attrs``.

        Raises LibraryError if pandas is not installed.
        """
        return frame(self.arrays(), index="t")

    def plan(self) -> Plan:
        """Return the plan of this run, to `simulate` it again, with the changes made while it ran.

        Raises RecordingError if the recording lacks something that the plan needs.
        """
        try:
            return Plan(self._recorded.plan())
        except (PlanError, ParameterError) as error:
            raise RecordingError(f"{self.path}: it cannot be run again: {error}") from None

    def save(self, path: AnyPath, *, overwrite: bool = False) -> None:
        """Copy the recording, byte for byte.

        Raises PlanError for a file that exists, unless ``overwrite``, for any suffix but ``.mcap``, and
        for a recording of several files.
        """
        from trunk_core.files import atomic_write

        target = output_path(path, (".mcap",), overwrite, [self.path])
        if self.path.is_dir():
            raise PlanError(f"{self.path}: a folder: copy it as a whole, or load one of its files")
        with writing(target), atomic_write(target) as part:
            shutil.copyfile(self.path, part)

    def _states(self) -> str:
        """Return how many states there are, in words, even if the recording cannot be read as a whole."""
        try:
            return f"{len(self)}, to t = {self.t[-1]:g} s"
        except (RecordingError, IndexError) as error:
            return f"none: {error}"

    def __repr__(self) -> str:
        facts = (self.scenario, ", ".join(self.controllers), self.mode)
        summary = ", ".join(fact for fact in facts if fact)
        return printable(f"Run({self.path.name}: {'; '.join((summary, *self.doubts))})")

    def _repr_html_(self) -> str:
        facts = {
            "recording": self.path.name,
            "scenario": self.scenario,
            "controllers": ", ".join(self.controllers),
            "mode": self.mode,
            "states": self._states(),
        }
        rows = [*facts.items(), *(("doubt", line) for line in self.doubts)]
        return html_table("Run", ("", ""), rows)


def load(path: AnyPath) -> Run:
    """Return a recorded run, from an MCAP file or from a folder that holds one, such as a ROS 2 bag.

    Broken files are read as far as they are sound: see `Run.doubts` and `Run.warnings`.
    Raises RecordingError for a file that is missing, cannot be read or is not MCAP.
    """
    from trunk_evidence.recorded_run import RecordedRun

    return Run(RecordedRun.open(path_of(path, "recording")))


def simulate(plan: Plan, *, output: AnyPath | None = None, overwrite: bool = False) -> Run:
    """Run a plan without ROS and return the recording: the same bits as the graph in lock-step.

    ``output``: the MCAP file to write; None: a temporary one that is deleted with the `Run`; `Run.save`
    keeps it. ``overwrite``: replace it if it exists.

    Raises PlanError for a plan that needs the graph or an output that cannot be written, and DivergedError
    if the loop is unstable: an ``output`` then holds the run up to its last finite state.
    """
    from trunk_runs.offline_recording import record_offline

    if not isinstance(plan, Plan):
        raise PlanError(f"simulate: {plan!r} is not a plan: give what trunk.plan(...) returns")
    name = f"{plan.scenario}_{'_'.join(plan.controllers)}.mcap"
    return recorded(
        lambda path: record_offline(plan._plan, path, overwrite=overwrite), name, output, overwrite
    )


def recorded(
    record: Callable[[Path], object],
    name: str,
    output: AnyPath | None,
    overwrite: bool,
    inputs: Iterable[Path] = (),
) -> Run:
    """Return the run that ``record`` writes to ``output``; None: to a temporary file of this name.

    A temporary file is deleted with the `Run`. ``inputs``: files that must not be written.
    """
    from trunk_evidence.recorded_run import RecordedRun

    if output is not None:
        path = output_path(output, (".mcap",), overwrite, inputs)
        with writing(path):
            record(path)
        return Run(RecordedRun.open(path))
    with writing(Path(tempfile.gettempdir())):
        folder = tempfile.mkdtemp(prefix="trunk_")
    path = Path(folder) / name
    try:
        with writing(path):
            record(path)
        run = Run(RecordedRun.open(path), _temporary=True)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(run, shutil.rmtree, folder, True)
    return run


def run_of(value: Run | AnyPath) -> Run:
    """Return a run, or the one that is recorded at a path."""
    return value if isinstance(value, Run) else load(value)


def branch(
    run: Run | AnyPath,
    at: float,
    *,
    overrides: Mapping[str, Any] = MappingProxyType({}),
    controller: str = "",
    pushes: Sequence[str] = (),
    duration: float | None = None,
    output: AnyPath | None = None,
    overwrite: bool = False,
) -> Run:
    """Return a run that is the recorded one up to ``at`` s, and from then on simulated with a change.

    ``overrides``: values from then on, by ``"NODE.PARAM"``, in SI units and radians.
    ``controller``: who acts from then on; empty: as recorded.
    ``pushes``: pulses, such as ``"60Nm:0.1s"`` or ``"hip_effort=300N:50ms@2.5s"``.
    ``duration``: when it ends, in s; None: as planned. ``output``, ``overwrite``: as for `simulate`.

    Raises PlanError for a change that is not possible, RecordingError for a run that does not verify up to
    ``at``, and DivergedError.
    """
    from trunk_evidence.branching import Branch, branch_plan, record_branch

    if isinstance(pushes, str):
        raise PlanError(f"pushes {pushes!r}: a list is needed, such as ['60Nm:0.1s']")
    values = mapping_of(overrides, "overrides", "{'NODE.PARAM': value}")
    settings = tuple(f"{name}={plain(value)}" for name, value in values.items())
    change = Branch(float(at), settings, controller, tuple(pushes), "overrides:")
    parent = run_of(run)._recorded
    plan = branch_plan(parent, change, duration)
    return recorded(
        lambda path: record_branch(parent, change, plan, path, overwrite),
        "branch.mcap",
        output,
        overwrite,
        [parent.path],
    )


def metrics(run: Run | AnyPath) -> Metrics:
    """Return the metrics of a `Run`, or of the recording at a path.

    Raises RecordingError if it cannot be read, or has no true states or no reference.
    """
    from trunk_evidence.run_table import recorded_metrics

    return recorded_metrics(run_of(run)._recorded)


def verify(run: Run | AnyPath) -> Verification:
    """Recompute every command of a recording and, where time was exact, every state.

    Raises RecordingError for a recording that cannot be read.
    """
    from trunk_evidence.judgement import verdict_on
    from trunk_evidence.verdict import verification

    recorded = run_of(run)._recorded
    return verification(recorded, verdict_on(recorded))


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
        from trunk_views.plots import save

        target = output_path(path, _SUFFIXES, overwrite)
        with writing(target):
            save(self.figure, target)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the picture, and its width in CSS pixels, 96 to the inch."""
        from trunk_views.plots import drawn

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
    from trunk_views.plots import FIGURES, overview, paper_figure
    from trunk_views.run_view import RunView

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
    from trunk_views.run_report import make_report, write
    from trunk_views.run_view import RunView

    if not runs:
        raise PlanError("report: no run: give at least one")
    opened = [run_of(run)._recorded for run in runs]
    target = output_path(output, (".html", ".htm"), overwrite, [run.path for run in opened])
    page = make_report([RunView.read(run) for run in opened])
    with writing(target):
        write(page, target)
