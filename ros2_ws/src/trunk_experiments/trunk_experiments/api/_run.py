"""`Run`: a recorded run as arrays, with what the recording says about it; where runs come from."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from trunk_msgs_util.errors import RecordingError
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.text import printable

from ..errors import PlanError
from ..results import html_table
from ._plan import Plan
from ._values import (
    COLUMNS,
    AnyPath,
    keyed,
    mapping_of,
    output_path,
    path_of,
    plain,
    writing,
)

if TYPE_CHECKING:
    import pandas as pd

    from trunk_msgs_util.parameters.declarations import Value
    from trunk_msgs_util.recording.joint_table import Floats

    from ..analysis.parameter_text import ChangedParameter
    from ..analysis.run_table import RunTable
    from ..recorded.run import RecordedRun


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
        from ..analysis.run_table import RunTable

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
        from ..replay.doubts import doubts_of

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
        from ..analysis.parameter_text import changed_parameters

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
        from ..analysis.run_table import disturbance, terms

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
        from ._values import frame

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
        from trunk_msgs_util.files import atomic_write

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
    from ..recorded.run import RecordedRun

    return Run(RecordedRun.open(path_of(path, "recording")))


def simulate(plan: Plan, *, output: AnyPath | None = None, overwrite: bool = False) -> Run:
    """Run a plan without ROS and return the recording: the same bits as the graph in lock-step.

    ``output``: the MCAP file to write; None: a temporary one that is deleted with the `Run`; `Run.save`
    keeps it. ``overwrite``: replace it if it exists.

    Raises PlanError for a plan that needs the graph or an output that cannot be written, and DivergedError
    if the loop is unstable: an ``output`` then holds the run up to its last finite state.
    """
    from ..runs.offline_recording import record_offline

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
    from ..recorded.run import RecordedRun

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
    from ..replay.branch import Branch, branch_plan, record_branch

    if isinstance(pushes, str):
        raise PlanError(f"pushes {pushes!r}: a list is needed, such as ['60Nm:0.1s']")
    values = mapping_of(overrides, "overrides", "{'NODE.PARAM': value}")
    settings = tuple(f"{name}={plain(value)}" for name, value in values.items())
    change = Branch(float(at), settings, controller, tuple(pushes))
    parent = run_of(run)._recorded
    plan = branch_plan(parent, change, duration)
    return recorded(
        lambda path: record_branch(parent, change, plan, path, overwrite),
        "branch.mcap",
        output,
        overwrite,
        [parent.path],
    )
