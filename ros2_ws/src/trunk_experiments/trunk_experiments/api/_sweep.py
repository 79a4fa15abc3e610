"""`Sweep`: the results of a study's runs, as columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from trunk_msgs_util.text import printable

from ..errors import PlanError, StudyError, SweepError
from ..results import html_table
from ._results import Picture
from ._study import Study
from ._values import AnyPath, output_path, path_of, writing

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    from trunk_msgs_util.recording.joint_table import Floats

    from ..study.compare import PairedDifference
    from ..study.results import Results

_KILLED = (
    "sweep: a worker process died: it ran out of memory, or the script lacks "
    'if __name__ == "__main__": around the call; add that, or give jobs=1'
)
_SHOWN = ("iae", "steady_state_error_rms_deg", "peak_torque")


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
        from ._values import frame

        return frame(self.arrays(), index="run")

    def compare(self, metrics: Sequence[str] = ()) -> tuple[PairedDifference, ...]:
        """Return the differences between each two controllers over the same draws, with 95 % intervals.

        ``metrics``: by name; empty: all. Angles and errors are compared by magnitude.
        Raises StudyError if there is only one controller, and for a metric that does not exist.
        """
        from ..study.compare import compare_study
        from ..study.results import METRICS

        return tuple(compare_study(self._results, tuple(metrics) or METRICS))

    def map(
        self, x: str, y: str | None = None, metric: str = "iae", *, floquet: bool = False
    ) -> Picture:
        """Draw a metric over two grids of the study, one panel for each controller; grey: most runs fell.

        Over ``x`` alone, each controller is a curve, and crosses are where most runs fell.
        ``floquet``: also draw where the linearised loop becomes unstable, which takes longer.
        Raises StudyError for a name that is not a grid of numbers.
        """
        from ..study.map import draw, draw_curves, panels

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

        from trunk_msgs_util.files import atomic_write

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
    if output is not None:
        return _swept(study, output_path(output, (".parquet",), overwrite), jobs, device, progress)
    with TemporaryDirectory(prefix="trunk_") as folder:
        sweep = _swept(study, Path(folder) / "sweep.parquet", jobs, device, progress)
    return replace(sweep, _results=replace(sweep._results, path=Path("the sweep")))


def _swept(
    study: Study,
    path: Path,
    jobs: int,
    device: str,
    progress: Callable[[int, int], None] | None,
) -> Sweep:
    from ..study.results import Results
    from ..study.sweep import SweepJob, device_runner, processes

    job, warnings, maker = SweepJob(study._study, path), list[str](), None
    if device == "cuda":
        from ..batch.cuda import on_cuda

        maker = on_cuda(warnings.append)
    with writing(path):
        done = job.start()

    def tell(runs: int) -> None:
        nonlocal done
        done += runs
        if progress is not None:
            progress(done, study.runs)

    try:
        with writing(path):
            workers = max(1, min(jobs, len(job.missing)))
            job.run(device_runner(maker) if maker else processes(workers), tell)
            job.finish()
    except SweepError as error:
        if isinstance(error.__context__, BrokenProcessPool):
            raise SweepError(_KILLED) from None
        raise
    remarks = maker.remarks() if maker else []
    return Sweep(Results.read(path), (*job.warnings, *warnings, *remarks))


def load_sweep(path: AnyPath) -> Sweep:
    """Return the results in a Parquet file written by `sweep` or ``trunk sweep``. Raises StudyError."""
    from ..study.results import Results

    return Sweep(Results.read(path_of(path, "results")))
