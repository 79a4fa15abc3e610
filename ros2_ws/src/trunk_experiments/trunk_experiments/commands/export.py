"""``trunk export``: a recorded run, or a part of it, in other formats."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import click
import numpy as np
from mcap.writer import Writer

from trunk_core import topics as names
from trunk_core.arrays import Floats
from trunk_core.files import atomic_write
from trunk_core.results import Count, Keyword
from trunk_core.units import NANOSECONDS
from trunk_evidence.doubts import RecordingResult, about
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable, all_columns, column_units
from trunk_recording.digests import END, PROVENANCE
from trunk_recording.mcap_file import McapFile
from trunk_recording.messages import Messages
from trunk_recording.reader import RecordingError

from ..console.document import json_option, write_json
from ..console.options import FORCE, Number, check_output, is_stream
from ..console.reading import open_run, show_damage

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
            count = write_mcap(recorded, output, start, end, topics)
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
            from trunk_views.animation import write_gif, write_mp4

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
    """Return the suffix that says what is written; a stream such as /dev/stdout takes CSV."""
    return ".csv" if is_stream(output) else output.suffix.lower()


_CSV_ROWS = 8192  # written at a time


def window(
    columns: Mapping[str, Floats], start: float = -inf, end: float = inf
) -> dict[str, Floats]:
    """Return the rows with ``start <= t <= end``, in s."""
    first = int(np.searchsorted(columns["t"], start, side="left"))
    last = int(np.searchsorted(columns["t"], end, side="right"))
    return {name: column[first:last] for name, column in columns.items()}


def write_csv(
    columns: Mapping[str, Floats], path: Path, units: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Write columns as CSV, one row per state; every number reads back as the same double.

    The header gives the ``units`` that are known as CSV files for parameters do: ``theta [rad]``.
    """
    headings = [f"{name} [{units[name]}]" if units.get(name) else name for name in columns]
    with atomic_write(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(headings) + "\n")
        for start in range(0, len(columns["t"]), _CSV_ROWS):
            rows = np.column_stack([c[start : start + _CSV_ROWS] for c in columns.values()])
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows.tolist())


def write_parquet(
    columns: Mapping[str, Floats], path: Path, units: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Write columns as Parquet, doubles to the last bit.

    The metadata has their ``units``: of each field ``unit``, and for pandas ``attrs["units"]``.
    """
    pyarrow = import_module("pyarrow")  # untyped, and 0.2 s to import
    parquet = import_module("pyarrow.parquet")
    arrays = [np.ascontiguousarray(column) for column in columns.values()]
    known = {name: units[name] for name in columns if name in units}
    fields = [
        pyarrow.field(name, pyarrow.float64(), metadata={"unit": known.get(name, "")})
        for name in columns
    ]
    schema = pyarrow.schema(fields, metadata={"PANDAS_ATTRS": json.dumps({"units": known})})
    with atomic_write(path) as part, part.open("wb") as file:
        parquet.write_table(pyarrow.table(arrays, schema=schema), file, compression="zstd")


def write_npz(columns: Mapping[str, Floats], path: Path) -> None:
    """Write columns as a compressed NumPy archive, one array each."""
    with (
        atomic_write(path) as part,
        part.open("wb") as file,
    ):  # given a name, NumPy would append .npz
        np.savez_compressed(file, **dict[str, Any](columns))  # its other arguments are typed too


def write_mcap(
    run: RecordedRun,
    path: Path,
    start: float = -inf,
    end: float = inf,
    topics: Collection[str] = (),
) -> int:
    """Copy messages with ``start <= stamp <= end`` in s, byte for byte; return their number.

    Stamps are the headers', or else log times. ``topics`` are absolute or relative; empty: all.
    Parameters set before the window are copied as well, since they apply in it. The end record marks
    anything less than the whole run as incomplete. Raises RecordingError for unknown topics.
    """
    recording, wanted = run.recording, _chosen(run, topics)
    first, last = _ns(start), _ns(end)
    parameters = run.topic(names.RUN_PARAMETERS)
    count = 0
    with atomic_write(path) as part, part.open("wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start("ros2", f"trunk_msgs_util export of {recording.library}")
        if recording.provenance:
            writer.add_metadata(PROVENANCE, recording.provenance)
        channels: dict[tuple[int, int], int] = {}
        schemas: dict[tuple[str, bytes], int] = {}
        for source, messages in recording.copies(wanted):
            number = messages.channels()
            stamp_ns = source.stamps(messages)
            is_parameters = np.array(
                [source.channels[int(c)].topic == parameters for c in np.unique(number)]
            )[np.searchsorted(np.unique(number), number)]
            rows = np.flatnonzero(
                (stamp_ns <= last) & ((stamp_ns >= first) | is_parameters),
            )
            for row in rows.tolist():
                key = (id(source), int(number[row]))
                if key not in channels:
                    channels[key] = _channel(writer, source, key[1], schemas)
                _copy(writer, channels[key], messages, row)
            count += len(rows)
        writer.flush()
        whole = recording.complete and start == -inf and end == inf and not topics
        reason = f"exported from {recording.path.name}"
        if not whole:
            reason += f"{_span(start, end)}, {len(wanted)} topics"
        writer.add_metadata(END, {"complete": str(whole).lower(), "reason": reason})
        writer.finish()
    return count


def _chosen(run: RecordedRun, topics: Collection[str]) -> list[str]:
    chosen = []
    for name in topics:
        absolute = name if name.startswith("/") else run.topic(name)
        if absolute not in run.recording.topics:
            raise RecordingError(
                f"{run.path} has no topic {absolute}, only {', '.join(run.recording.topics)}"
            )
        chosen.append(absolute)
    return chosen or list(run.recording.topics)


def _span(start: float, end: float) -> str:
    """Return a window of time in words; an open end is left out."""
    if start == -inf:
        return "" if end == inf else f", up to t = {end:g} s"
    return f", from t = {start:g} s" if end == inf else f", t = {start:g} to {end:g} s"


def _ns(time: float) -> float:
    return time if abs(time) == inf else round(time * NANOSECONDS)


def _channel(
    writer: Writer, source: McapFile, number: int, schemas: dict[tuple[str, bytes], int]
) -> int:
    channel = source.channels[number]
    schema = source.schemas.get(channel.schema_id)
    new = 0
    if schema is not None:
        key = (schema.name, schema.data)
        if key not in schemas:
            schemas[key] = writer.register_schema(schema.name, schema.encoding, schema.data)
        new = schemas[key]
    return writer.register_channel(
        channel.topic, channel.message_encoding, new, dict(channel.metadata)
    )


def _copy(writer: Writer, channel: int, messages: Messages, row: int) -> None:
    data, log, start, end = messages
    at = int(start[row])
    sequence = int.from_bytes(data[at - 20 : at - 16], "little")
    publish = int.from_bytes(data[at - 8 : at], "little")
    writer.add_message(channel, int(log[row]), data[at : int(end[row])], publish, sequence)
