"""``trunk metrics``: how well a recorded run held the trunk."""

from __future__ import annotations

import json
from pathlib import Path

import click

from trunk_msgs_util.recording.reader import RecordingError

from ..analysis.metrics import QUANTITIES, has_level, metrics, missing
from ..analysis.run_table import RunTable
from ..console.common import json_option, print_table
from ..console.reading import open_run, show_warnings
from ..recorded.run import RecordedRun
from ..replay.doubts import doubts_of


def show_metrics(run: RecordedRun, title: str) -> None:
    """Print a run's metrics as a table; warnings, and what makes them doubtful, first."""
    doubts = doubts_of(run)
    for line in doubts.lines:
        click.echo(line)
    show_warnings(run.recording.further_warnings)
    table, values = _values(run)
    level = has_level(table)
    print_table(
        f"{title}, INCOMPLETE" if doubts.incomplete else title,
        ("quantity", "value", "unit"),
        [
            (q.label, missing(key, level) if values[key] is None else f"{values[key]:.6g}", q.unit)
            for key, q in QUANTITIES.items()
        ],
    )


def _values(run: RecordedRun) -> tuple[RunTable, dict[str, float | None]]:
    # Only what metrics need: an hour at 1 kHz then takes a third of a GiB.
    table = RunTable.from_run(run, only=("reference",))
    try:
        return table, metrics(table).as_dict()
    except ValueError as error:
        raise RecordingError(f"{run.path}: {error}") from None


@click.command("metrics")
@click.argument("run", type=click.Path(path_type=Path))
@json_option("Print JSON; null if a quantity does not exist.")
def command(run: Path, as_json: bool) -> None:
    """Print a recorded run's metrics."""
    recorded = open_run(run)
    if as_json:
        show_warnings(recorded.recording.further_warnings)
        values = {"doubts": doubts_of(recorded).as_values(), **_values(recorded)[1]}
        click.echo(json.dumps(values, indent=2))
    else:
        show_metrics(recorded, f"{run.resolve().name}: true error e = reference - angle")
