"""``trunk metrics``: how well a recorded run held the trunk."""

from __future__ import annotations

from pathlib import Path

import click

from trunk_msgs_util.errors import RecordingError
from trunk_msgs_util.files import resolve_path

from ..analysis.metrics import QUANTITIES, has_level, missing
from ..analysis.run_table import recorded_metrics, table_and_metrics
from ..console.document import json_option, write_json
from ..console.reading import Values, open_run, run_values
from ..console.tables import print_table
from ..console.terminal import show_warnings
from ..recorded.run import RecordedRun
from ..replay.doubts import doubts_of


def show_metrics(run: RecordedRun, title: str) -> None:
    """Print a run's metrics as a table; warnings, and what makes them doubtful, first."""
    doubts = doubts_of(run)
    try:
        table, measured = table_and_metrics(run)
    except RecordingError:
        show_warnings(doubts.lines)  # a likely cause
        raise
    for line in doubts.lines:
        click.echo(line)
    show_warnings(run.recording.further_warnings)
    values = measured.as_dict()
    level = has_level(table)
    print_table(
        f"{title}, INCOMPLETE" if doubts.incomplete else title,
        ("quantity", "value", "unit"),
        [
            (
                q.label,
                missing(key, level) if values[key] is None else f"{values[key]:.6g}",
                q.terminal_unit,
            )
            for key, q in QUANTITIES.items()
        ],
    )


def metrics_values(run: RecordedRun) -> Values:
    """Return a document's values of a run and its metrics, with the twin in lock-step."""
    return {**run_values(run, doubts_of(run)), "metrics": recorded_metrics(run).as_dict()}


@click.command("metrics")
@click.argument("run", type=click.Path(path_type=Path))
@json_option("metrics-1")
def command(run: Path, as_json: bool) -> None:
    """Print a recorded run's metrics."""
    recorded = open_run(run)
    if as_json:
        show_warnings(recorded.recording.further_warnings)
        write_json("metrics-1", metrics_values(recorded))
    else:
        show_metrics(recorded, f"{resolve_path(run).name}: true error e = reference - angle")
