"""`Study`: which runs a sweep makes, from names, overrides and what varies; `Sweep`: the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import yaml

from trunk_core.errors import PlanError, StudyError, SweepError
from trunk_core.results import html_table
from trunk_core.text import printable
from trunk_core.yaml_text import dump

from ._run import Picture
from ._values import (
    AnyPath,
    frame,
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
    from numpy.typing import NDArray

    from trunk_core.arrays import Floats
    from trunk_studies.statistics import PairedDifference
    from trunk_studies.study import StudySpec
    from trunk_studies.sweep_results import Results

How = Literal["value", "factor", "offset"]
Distribution = Literal["uniform", "loguniform", "normal", "integers", "choice"]

_KILLED = (
    "sweep: a worker process died: it ran out of memory, or the script lacks "
    'if __name__ == "__main__": around the call; add that, or give jobs=1'
)
_SHOWN = ("iae", "steady_state_error_rms_deg", "peak_torque")


@dataclass(frozen=True)
class Contender:
    """One controller of a study: its node, and its own parameter files and overrides."""

    node: str
    params: AnyPath | Sequence[AnyPath] = ()
    overrides: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Variation:
    """What varies in a study, as written in its file. Made by `grid` and `draw`."""

    entry: Mapping[str, Any]


@dataclass(frozen=True, repr=False)
class Study:
    """The runs that a sweep makes. Made by `study` and `read_study`."""

    _study: StudySpec

    @property
    def text(self) -> str:
        """The study as the YAML file that `trunk sweep` takes."""
        return self._study.text

    @property
    def runs(self) -> int:
        """How many runs there are in all: grid points times draws times controllers."""
        return self._study.total

    @property
    def controllers(self) -> tuple[str, ...]:
        """The controllers' labels."""
        return tuple(contender.label for contender in self._study.contenders)

    @property
    def variables(self) -> tuple[str, ...]:
        """The names of what varies; each is a column of the results."""
        return tuple(variable.name for variable in self._study.variables)

    def __repr__(self) -> str:
        return (
            f"Study({self._study.scenario}: {self.runs} runs of {', '.join(self.controllers)} "
            f"over {', '.join(self.variables)})"
        )


def grid(parameter: str | Sequence[str], values: Sequence[Any], *, how: How = "value") -> Variation:
    """Return a variation over given values; all grids of a study are combined.

    ``parameter``: ``"NODE.PARAM"`` or ``"NODE.PARAM[INDEX]"``, or several that vary together; the node
    ``controller`` is whichever controller runs. ``values``: numbers (a NumPy array too), strings or bools.
    ``how``: a value replaces the parameter, multiplies it as a factor, or is added to it as an offset.
    """
    return _variation(parameter, how, {"values": plain(values)})


def draw(
    parameter: str | Sequence[str],
    distribution: Distribution,
    *,
    low: float | None = None,
    high: float | None = None,
    mean: float | None = None,
    std: float | None = None,
    values: Sequence[Any] | None = None,
    how: How = "value",
) -> Variation:
    """Return a variation that is drawn for each run, from its own random stream.

    ``distribution``: ``uniform``, ``loguniform`` or ``integers`` need ``low`` and ``high``, ``normal`` needs
    ``mean`` and ``std`` (``low`` and ``high`` truncate it), ``choice`` needs ``values``. All are in
    the parameter's unit, unless ``how`` is ``factor``. The rest is as for `grid`.
    """
    given = {"low": low, "high": high, "mean": mean, "std": std, "values": values}
    options = {name: plain(value) for name, value in given.items() if value is not None}
    return _variation(parameter, how, {"distribution": distribution, **options})


def _variation(parameter: str | Sequence[str], how: How, rest: Mapping[str, Any]) -> Variation:
    entry = {"parameter": plain(parameter), "as": how, **rest}
    return Variation(MappingProxyType(entry))


def study(
    scenario: AnyPath,
    controllers: Sequence[str] | Mapping[str, Contender],
    vary: Mapping[str, Variation],
    *,
    params: AnyPath | Sequence[AnyPath] = (),
    overrides: Mapping[str, Any] = MappingProxyType({}),
    duration: float | None = None,
    rate: float | None = None,
    runs: int = 1,
    seed: int = 1,
) -> Study:
    """Return a study. The draws are the same for all controllers and at all points of the grid.

    ``scenario``, ``params``, ``overrides``, ``duration`` in s, ``rate`` in Hz: as for `plan`, for all runs.
    ``controllers``: some of `controllers`, or your own labels, each with a `Contender`.
    ``vary``: what varies, made by `grid` and `draw`, by the name of its column in the results.
    ``runs``: draws at each point of the grid. ``seed``: of the draws.

    Raises StudyError: one line with the place, the value, and what is allowed. `sweep` checks the
    parameters' names and bounds, before its first run.
    """
    contenders: Any = plain(controllers)
    if isinstance(controllers, Mapping):
        contenders = {str(label): _contender(contender) for label, contender in controllers.items()}
    such_as = "{'mass': trunk.grid('simulator.plant.trunk_mass', [0.4, 0.6])}"
    varied = mapping_of(vary, "vary", such_as)
    tree = {
        "scenario": str(path_of(scenario, "scenario")),
        "controllers": contenders,
        "params": names_of(params, "params"),
        "set": _overrides(overrides),
        "rate": number_of(rate, "rate"),
        "duration": number_of(duration, "duration"),
        "runs": plain(runs),
        "seed": plain(seed),
        "vary": {str(name): _entry(name, variation) for name, variation in varied.items()},
    }
    return Study(_parsed({name: value for name, value in tree.items() if value is not None}))


def read_study(name: AnyPath) -> Study:
    """Return the study in a YAML file, given by its path or as one of `studies`. Raises StudyError."""
    from trunk_studies.study import read_study as read

    return Study(read(str(path_of(name, "study"))))


def _parsed(tree: Mapping[str, Any]) -> StudySpec:
    """Return the study that a file's content describes, checked as every study is."""
    from trunk_studies.study import parse_study

    try:
        text = dump(dict(tree), allow_unicode=True)
    except yaml.YAMLError as error:
        raise StudyError(f"study: {' '.join(str(error).split())}") from None
    return parse_study(text, "study")


def _overrides(value: Mapping[str, Any]) -> dict[str, Any]:
    overrides = mapping_of(value, "overrides", "{'NODE.PARAM': value}")
    return {str(name): plain(override) for name, override in overrides.items()}


def _contender(contender: Contender) -> dict[str, Any]:
    if not isinstance(contender, Contender):
        raise StudyError(
            f"controllers: {contender!r} is not a contender: give trunk.Contender('pid', ...)"
        )
    return {
        "node": contender.node,
        "params": names_of(contender.params, "params"),
        "set": _overrides(contender.overrides),
    }


def _entry(name: str, variation: Variation) -> dict[str, Any]:
    if not isinstance(variation, Variation):
        raise StudyError(f"vary: {name}: {variation!r}: give trunk.grid(...) or trunk.draw(...)")
    return dict(variation.entry)


@dataclass(frozen=True, repr=False, eq=False)
class Sweep:
    """The results of a sweep: columns [runs], one row for each run. Made by `sweep` and `load_sweep`.

    Columns: ``run``, ``controller``, ``point`` of the grid, ``draw``, ``seed``, what varies, ``status``
    (``ok``, ``diverged``, ``refused``), ``reason``, ``fell``, ``diverged_at_s`` and the metrics by name.
    ``warnings``: those of the plans, one line each.
    """

    _results: Results
    warnings: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns' names."""
        return tuple(self._results.table.column_names)

    @property
    def controllers(self) -> tuple[str, ...]:
        """The controllers' labels, in the study's order."""
        return self._results.controllers

    @property
    def fallen(self) -> Floats:
        """1.0 if the trunk fell or the plant diverged, 0.0 if not, NaN if the run was refused."""
        return self._results.fallen

    def __len__(self) -> int:
        """Return the number of runs."""
        return int(self._results.table.num_rows)

    def __getitem__(self, column: str) -> NDArray[Any]:
        """Return a column [runs]: whole numbers, float64 with NaN where there is no value, or strings.

        Raises StudyError for a name that no column has.
        """
        import numpy as np
        import pyarrow as pa

        table = self._results.table
        if column in table.column_names:
            values = table[column]
            if pa.types.is_string(values.type) or pa.types.is_boolean(values.type):
                return np.array(values.to_pylist(), dtype=object)
            if pa.types.is_integer(values.type) and not values.null_count:
                return np.asarray(values.to_numpy())
        return self._results.column(column)

    def of(self, controller: str) -> Sweep:
        """Return one controller's rows. Raises StudyError for one that is not in the study."""
        if controller not in self.controllers:
            raise StudyError(
                f"no controller {controller!r} in the sweep: one of {', '.join(self.controllers)}"
            )
        return replace(self, _results=self._results.of(controller))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all columns by name, each [runs]; `UNITS` has the units of the metrics."""
        return {name: self[name] for name in self.columns}

    def frame(self) -> pd.DataFrame:
        """Return all columns as a pandas DataFrame with the index ``run``; metrics' units in ``attrs``.

        Raises LibraryError if pandas is not installed.
        """
        return frame(self.arrays(), index="run")

    def compare(self, metrics: Sequence[str] = ()) -> tuple[PairedDifference, ...]:
        """Return the differences between each two controllers over the same draws, with 95 % intervals.

        ``metrics``: by name; empty: all. Angles and errors are compared by magnitude.
        Raises StudyError if there is only one controller, and for a metric that does not exist.
        """
        from trunk_studies.statistics import compare_study
        from trunk_studies.sweep_results import METRICS

        return tuple(compare_study(self._results, tuple(metrics) or METRICS))

    def map(
        self, x: str, y: str | None = None, metric: str = "iae", *, floquet: bool = False
    ) -> Picture:
        """Draw a metric over two grids of the study, one panel for each controller; grey: most runs fell.

        Over ``x`` alone, each controller is a curve, and crosses are where most runs fell.
        ``floquet``: also draw where the linearised loop becomes unstable, which takes longer.
        Raises StudyError for a name that is not a grid of numbers.
        """
        from trunk_studies.stability_map import draw, draw_curves, panels

        if x == y:
            raise StudyError(f"map: x and y are both {x!r}: give two different grids")
        axes = (x,) if y is None else (x, y)
        drawn = panels(self._results, metric, axes, floquet)
        study, title = self._results.study, f"{len(self)} runs"
        if y is None:
            return Picture(draw_curves(drawn, metric, x, study, title))
        return Picture(draw(drawn, metric, axes, study, title))

    def save(self, path: AnyPath, *, overwrite: bool = False) -> None:
        """Write the results as Parquet, for `load_sweep`, `trunk study map` and `trunk study compare`.

        Raises PlanError for a file that exists, unless ``overwrite``, or a name not ending in ``.parquet``.
        """
        import pyarrow.parquet as pq

        from trunk_core.files import atomic_write

        target = output_path(path, (".parquet",), overwrite)
        with writing(target), atomic_write(target) as part:
            pq.write_table(self._results.table, part, compression="zstd")

    def __repr__(self) -> str:
        fallen = int((self.fallen == 1.0).sum())
        summary = f"{len(self)} runs of {', '.join(self.controllers)}; {fallen} fell"
        return printable(f"Sweep({'; '.join((summary, *self.warnings))})")

    def _repr_html_(self) -> str:
        rows = [self._row(name) for name in self.controllers]
        header = ("controller", "runs", "fell", *(f"{name}, median" for name in _SHOWN))
        return html_table("Sweep", header, rows)

    def _row(self, controller: str) -> tuple[str, ...]:
        import numpy as np

        rows = self.of(controller)
        columns = [values[~np.isnan(values)] for values in (rows[name] for name in _SHOWN)]
        medians = [f"{np.median(values):.4g}" if len(values) else "" for values in columns]
        return controller, str(len(rows)), str(int((rows.fallen == 1.0).sum())), *medians


def sweep(
    study: Study,
    *,
    output: AnyPath | None = None,
    overwrite: bool = False,
    jobs: int = 1,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Run a study in compiled code, with the same bits as `simulate`, and return the metrics of its runs.

    ``output``: the Parquet file to write, as ``trunk sweep`` does; an interrupted sweep resumes.
    None: nothing is kept on disk. ``jobs``: how many processes; with more than one, a script needs
    ``if __name__ == "__main__":`` around the call, as for `multiprocessing`.
    ``device``: "cuda" makes the runs on a GPU, with the same bits; those that it cannot make are made on the
    CPU, and `Sweep.warnings` says why.
    ``progress``: called with the number of finished runs and the total.

    The first sweep after a change of version takes some seconds to compile. Raises StudyError, before the
    first run, for a study that is not possible, SweepError if a process was killed, and NotInstalledError or
    LibraryError if there is no GPU that can be used.
    """
    if not isinstance(study, Study):
        raise PlanError(f"sweep: {study!r} is not a study: give what trunk.study(...) returns")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or not 1 <= jobs <= 1024:
        raise PlanError(f"sweep: jobs is {jobs!r}: a whole number from 1 to 1024 is needed")
    if device not in ("cpu", "cuda") or (device == "cuda" and jobs != 1):
        raise PlanError(f"sweep: device is {device!r}, jobs {jobs}: cpu, or cuda with jobs=1")
    tell = progress or (lambda done, of: None)
    if output is not None:
        return _swept(study, output_path(output, (".parquet",), overwrite), jobs, device, tell)
    with TemporaryDirectory(prefix="trunk_") as folder:
        sweep = _swept(study, Path(folder) / "sweep.parquet", jobs, device, tell)
    return replace(sweep, _results=replace(sweep._results, path=Path("the sweep")))


def _swept(
    study: Study,
    path: Path,
    jobs: int,
    device: str,
    progress: Callable[[int, int], None],
) -> Sweep:
    from trunk_studies.sweep_execution import SweepJob, device_runner, processes
    from trunk_studies.sweep_results import Results

    job, warnings, maker = SweepJob(study._study, path), list[str](), None
    if device == "cuda":
        from trunk_studies.batch.cuda import on_cuda

        maker = on_cuda(warnings.append)
    with writing(path):
        job.start()
    try:
        with writing(path):
            workers = max(1, min(jobs, len(job.missing)))
            job.run(device_runner(maker) if maker else processes(workers), progress)
            job.finish()
    except SweepError as error:
        if isinstance(error.__context__, BrokenProcessPool):
            raise SweepError(_KILLED) from None
        raise
    remarks = maker.remarks() if maker else []
    return Sweep(Results.read(path), (*job.warnings, *warnings, *remarks))


def load_sweep(path: AnyPath) -> Sweep:
    """Return the results in a Parquet file written by `sweep` or ``trunk sweep``. Raises StudyError."""
    from trunk_studies.sweep_results import Results

    return Sweep(Results.read(path_of(path, "results")))
