"""``trunk metrics``: how well a recorded run held the trunk."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from trunk_core.errors import RecordingError
from trunk_core.files import resolve_path
from trunk_evidence.doubts import RecordingResult, about, doubts_of
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_metrics import Metrics
from trunk_evidence.run_table import keep_for_metrics, recorded_metrics

from ..console.document import json_option, write_json
from ..console.reading import open_run
from ..console.tables import print_table
from ..console.terminal import show_warnings


@dataclass(frozen=True)
class MetricsResult(RecordingResult, document="metrics-1"):
    """The document of ``trunk metrics RUN``."""

    metrics: Metrics


def show_metrics(run: RecordedRun, title: str) -> None:
    """Print a run's metrics as a table; warnings, and what makes them doubtful, first."""
    keep_for_metrics(run)
    doubts = doubts_of(run)
    try:
        measured = recorded_metrics(run)
    except RecordingError:
        show_warnings(doubts.lines)  # a likely cause
        raise
    for line in doubts.lines:
        click.echo(line)
    show_warnings(run.recording.further_warnings)
    print_table(
        f"{title}, INCOMPLETE" if not doubts.complete else title,
        ("quantity", "value", "unit"),
        [
            (run.of_drive(label), value, run.of_drive(unit).replace("·", " "))
            for label, value, unit in measured.rows()
        ],
    )


@click.command("metrics")
@click.argument("run", type=click.Path(path_type=Path))
@json_option(MetricsResult)
def command(run: Path, as_json: bool) -> None:
    """Print a recorded run's metrics."""
    recorded = open_run(run)
    if as_json:
        keep_for_metrics(recorded)
        show_warnings(recorded.recording.further_warnings)
        write_json(
            MetricsResult(
                **vars(about(recorded, doubts_of(recorded))), metrics=recorded_metrics(recorded)
            )
        )
    else:
        show_metrics(recorded, f"{resolve_path(run).name}: true error e = reference - angle")
