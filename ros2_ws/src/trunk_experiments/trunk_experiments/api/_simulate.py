"""Where runs come from: a recording, or a plan."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterable
from pathlib import Path

from ..errors import PlanError
from ._paths import AnyPath, output_path, path_of, writing
from ._plan import Plan
from ._run import Run


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
        run = Run(RecordedRun.open(path))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(run, shutil.rmtree, folder, True)
    return run


def run_of(value: Run | AnyPath) -> Run:
    """Return a run, or the one that is recorded at a path."""
    return value if isinstance(value, Run) else load(value)
