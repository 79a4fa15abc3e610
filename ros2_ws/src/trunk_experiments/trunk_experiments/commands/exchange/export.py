"""``trunk export``: a recorded run, or a part of it, in other formats; ``trunk export fuzzy``: rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, NamedTuple

import click

from ...analysis.run_table import RunTable, all_columns, column_units
from ...console.document import json_option, write_json
from ...console.options import Number
from ...console.outputs import check_output
from ...console.reading import open_run, show_damage
from ...console.verbs import VerbWithVerbs
from ...replay.doubts import RecordingResult, about
from ...results import Count, Keyword
from ...views.extract import window, write_csv, write_mcap, write_npz, write_parquet
from .export_rules import command as rules_command

_FILE = click.Path(path_type=Path)


class ExportedFile(NamedTuple):
    """A file that was written."""

    file: Path
    rows: Annotated[Count | None, "Of a table, or states of an animation; null for MCAP"]
    messages: Annotated[Count | None, "Of an MCAP file; null for others"]


@dataclass(frozen=True)
class ExportResult(RecordingResult, document="export-1"):
    """The document of ``trunk export``."""

    outputs: Annotated[Sequence[ExportedFile], Keyword("minItems", 1)]


@click.group("export", cls=VerbWithVerbs)
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--csv",
    type=_FILE,
    help="CSV: one row per true state, terms and disturbance too, full precision.",
)
@click.option("--units", is_flag=True, help="With --csv: a header with units, such as theta [rad].")
@click.option("--parquet", type=_FILE, help="Parquet: the same columns, units in the metadata.")
@click.option("--npz", type=_FILE, help="NumPy archive: the same columns.")
@click.option("--gif", type=_FILE, help="Animated picture, for slides; at most 120 s.")
@click.option("--mp4", type=_FILE, help="The same as a film, by ffmpeg; at most 120 s.")
@click.option("--mcap", type=_FILE, help="MCAP: messages as they are, byte for byte.")
@click.option("--force", is_flag=True, help="Replace files that exist.")
@click.option("--from", "start", type=Number("s"), default=-inf, metavar="S", help="Start time, s.")
@click.option("--to", "end", type=Number("s"), default=inf, metavar="S", help="End time, s.")
@click.option(
    "--topics",
    multiple=True,
    metavar="TOPIC",
    help="For --mcap: only this topic; repeatable.",
)
@json_option(ExportResult)
@click.pass_context
def command(
    ctx: click.Context,
    run: Path,
    csv: Path | None,
    units: bool,
    parquet: Path | None,
    npz: Path | None,
    gif: Path | None,
    mp4: Path | None,
    mcap: Path | None,
    force: bool,
    start: float,
    end: float,
    topics: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write a recorded run as CSV, Parquet, NumPy archive, GIF, MP4 or MCAP; SI units and radians.

    Times are simulated seconds, by the messages' stamps; both ends are included.
    """
    files = {"csv": csv, "parquet": parquet, "npz": npz, "gif": gif, "mp4": mp4, "mcap": mcap}
    if not any(files.values()):
        ctx.fail(f"give at least one of {', '.join(f'--{suffix}' for suffix in files)}")
    if topics and not mcap:
        ctx.fail("--topics is for --mcap only; tables have fixed columns")
    if units and not csv:
        ctx.fail("--units is for --csv only; Parquet always has them")
    if not start <= end:
        ctx.fail(f"--from {start:g} must not be after --to {end:g}")
    for suffix, output in files.items():
        if output is not None:
            check_output(output, (f".{suffix}",), force, [run], f"--{suffix}")
    recorded = open_run(run)
    show_damage(recorded)
    written: list[ExportedFile] = []
    if csv or parquet or npz or gif or mp4:
        table = window(all_columns(recorded, RunTable.from_run(recorded)), start, end)
        if csv:
            write_csv(table, csv, column_units(recorded) if units else {})
        if parquet:
            write_parquet(table, parquet, column_units(recorded))
        if npz:
            write_npz(table, npz)
        if gif or mp4:
            from ...views.film import write_gif, write_mp4

            plant = recorded.parameters.get("simulator", {})
            for write, film in ((write_gif, gif), (write_mp4, mp4)):
                if film:
                    write(table, plant, film)
        for output in filter(None, (csv, parquet, npz, gif, mp4)):
            written.append(ExportedFile(output, len(table["t"]), None))
    if mcap:
        count = write_mcap(recorded.recording, mcap, start, end, topics)
        written.append(ExportedFile(mcap, None, count))
    if as_json:
        write_json(ExportResult(**vars(about(recorded)), outputs=written))
        return
    for entry in written:
        text = f"{entry.messages} messages" if entry.rows is None else f"{entry.rows} rows"
        click.echo(f"{entry.file}: {text}")


command.add_command(rules_command)
