"""``trunk export``: a recorded run, or a part of it, in other formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import click

from ..analysis.run_table import RunTable, all_columns, column_units
from ..console.document import json_option, write_json
from ..console.options import Number
from ..console.outputs import FORCE, check_output, is_stream
from ..console.reading import open_run, show_damage
from ..replay.doubts import RecordingResult, about
from ..results import Count, Keyword
from ..views.extract import window, write_csv, write_mcap, write_npz, write_parquet

_FORMATS = (".csv", ".parquet", ".npz", ".gif", ".mp4", ".mcap")


class ExportedFile(NamedTuple):
    """A file that was written."""

    file: Path
    rows: Annotated[Count | None, "Of a table, or states of an animation; null for MCAP"]
    messages: Annotated[Count | None, "Of an MCAP file; null for others"]


@dataclass(frozen=True)
class ExportResult(RecordingResult, document="export-1"):
    """The document of ``trunk export``."""

    outputs: Annotated[Sequence[ExportedFile], Keyword("minItems", 1)]


@click.command("export")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    "outputs",
    type=click.Path(path_type=Path),
    multiple=True,
    required=True,
    metavar="FILE",
    help="A file to write, in the format of its suffix; repeatable.",
)
@click.option("--force", is_flag=True, help=FORCE)
@click.option("--units", is_flag=True, help="CSV: a header with units, such as theta [rad].")
@click.option("--from", "start", type=Number("s"), default=-inf, metavar="S", help="Start time, s.")
@click.option("--to", "end", type=Number("s"), default=inf, metavar="S", help="End time, s.")
@click.option(
    "--topics",
    multiple=True,
    metavar="TOPIC",
    help="MCAP: only this topic; repeatable.",
)
@json_option(ExportResult)
@click.pass_context
def command(
    ctx: click.Context,
    run: Path,
    outputs: tuple[Path, ...],
    units: bool,
    force: bool,
    start: float,
    end: float,
    topics: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write a recorded run, or a part of it, in other formats; SI units and radians.

    .csv, .parquet and .npz have a row for each true state, with terms and disturbance, in full precision;
    .gif and .mp4 are animated, for slides, of at most 120 s; .mcap has the messages byte for byte. Times are
    simulated seconds, by the messages' stamps; both ends are included.
    """
    formats = {output: _format_of(output) for output in outputs}
    if topics and ".mcap" not in formats.values():
        ctx.fail("--topics is for .mcap only; tables have fixed columns")
    if units and ".csv" not in formats.values():
        ctx.fail("--units is for .csv only; Parquet always has them")
    if not start <= end:
        ctx.fail(f"--from {start:g} must not be after --to {end:g}")
    for output in outputs:
        check_output(output, _FORMATS, force, [run])
        if outputs.count(output) > 1:
            ctx.fail(f"--output {output}: it is given twice: give each file once")
    recorded = open_run(run)
    show_damage(recorded)
    written: list[ExportedFile] = []
    table: Mapping[str, Any] = {}
    for output, suffix in formats.items():
        if suffix == ".mcap":
            count = write_mcap(recorded.recording, output, start, end, topics)
            written.append(ExportedFile(output, None, count))
            continue
        table = table or window(all_columns(recorded, RunTable.from_run(recorded)), start, end)
        if suffix == ".csv":
            write_csv(table, output, column_units(recorded) if units else {})
        elif suffix == ".parquet":
            write_parquet(table, output, column_units(recorded))
        elif suffix == ".npz":
            write_npz(table, output)
        else:
            from ..views.film import write_gif, write_mp4

            write = write_gif if suffix == ".gif" else write_mp4
            write(table, recorded.parameters.get("simulator", {}), output)
        written.append(ExportedFile(output, len(table["t"]), None))
    if as_json:
        write_json(ExportResult(**vars(about(recorded)), outputs=written))
        return
    for entry in written:
        kind = "messages" if entry.rows is None else "rows"
        click.echo(f"{entry.file}: {getattr(entry, kind)} {kind}")


def _format_of(output: Path) -> str:
    """Return the suffix that says what is written: what is no file, such as /dev/stdout, takes CSV."""
    return ".csv" if is_stream(output) else output.suffix.lower()
