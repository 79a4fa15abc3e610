"""Metrics of a recorded run."""

from __future__ import annotations

from trunk_msgs_util.recording.reader import RecordingError

from ..recorded.run import RecordedRun
from .metrics import RunMetrics, metrics
from .run_table import RunTable


def table_and_metrics(run: RecordedRun) -> tuple[RunTable, RunMetrics]:
    """Return a recorded run's table, as far as metrics need it, and its metrics.

    Raises RecordingError if it has none, or cannot be read.
    """
    # Only what metrics need: an hour at 1 kHz then takes a third of a GiB.
    table = RunTable.from_run(run, only=("reference",))
    try:
        return table, metrics(table)
    except ValueError as error:
        raise RecordingError(f"{run.path}: {error}") from None


def recorded_metrics(run: RecordedRun) -> RunMetrics:
    """Return a recorded run's metrics. Raises RecordingError if it has none, or cannot be read."""
    return table_and_metrics(run)[1]
