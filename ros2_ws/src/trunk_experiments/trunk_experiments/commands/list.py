"""``trunk list``: the runs in a folder, and what is shipped, each with its path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import click

from trunk_core.errors import PlanError
from trunk_core.results import Result, number
from trunk_evidence.doubts import RecordingResult, Word, about, doubts_of

from ..console.document import json_option, schemas, write_json
from ..console.reading import open_run
from ..console.tables import aligned, print_table
from ..console.terminal import show_warnings
from ..console.verbs import Verbs

# Column headings of the metrics by which docs/paper.md judges.
_SHOWN = {
    "overshoot_deg": "overshoot, °",
    "settling_time_6deg_s": "settles ±6°, s",
    "steady_state_error_mean_deg": "mean, °",
    "steady_state_error_rms_deg": "RMS, °",
    "iae": "IAE",
}
UNJUDGED = "unjudged"  # not recomputed here, whoever verified it before


@dataclass(frozen=True)
class ListedRun(RecordingResult):
    """A recording in a folder."""

    started: Annotated[str | None, "UTC, ISO 8601"] = None
    scenario: str | None = None
    controllers: tuple[str, ...] = ()
    mode: str | None = None
    metrics: Annotated[Mapping[str, float | None], "Empty if there are none"] = field(
        default_factory=dict
    )
    error: Annotated[str | None, "Why it cannot be read"] = None

    @property
    def words(self) -> tuple[str, ...]:
        """What makes it doubtful: FELL, LATE, INCOMPLETE."""
        return tuple(line.split(":")[0] for line in self.doubts.lines) if self.doubts else ()

    @property
    def verdict(self) -> str:
        """The verdict of `trunk verify`, where it was asked for."""
        return UNJUDGED if self.doubts is None else self.doubts.judged or UNJUDGED


@dataclass(frozen=True)
class ListRunsResult(Result, document="list-runs-1"):
    """The document of ``trunk list runs``."""

    runs: Annotated[Sequence[ListedRun], "The newest first"]


@dataclass(frozen=True)
class ListFilesResult(Result, document="list-files-1"):
    """The document of ``trunk list scenarios``, files, studies."""

    files: Annotated[Mapping[str, Path], "Path by name"]


@dataclass(frozen=True)
class ListSchemasResult(Result, document="list-schemas-1"):
    """The document of ``trunk list schemas``."""

    schemas: Annotated[Mapping[str, Mapping[str, object]], "JSON Schema by name"]


class ListedController(NamedTuple):
    """A controller and how it is started."""

    label: str
    command: Annotated[Sequence[str], "The words that start the node"]


@dataclass(frozen=True)
class ListControllersResult(Result, document="list-controllers-1"):
    """The document of ``trunk list controllers``."""

    controllers: Mapping[str, ListedController]


class ListedCoordinate(NamedTuple):
    """What moves in a plant."""

    joint: str
    unit: str


class ListedPlant(NamedTuple):
    """A plant: what it is called, who brings it, what moves in it."""

    label: str
    package: str
    coordinates: Annotated[Sequence[ListedCoordinate], "The free one, then the held one"]
    drive: Annotated[str, "The joint that the command pushes"]


@dataclass(frozen=True)
class ListPlantsResult(Result, document="list-plants-1"):
    """The document of ``trunk list plants``."""

    plants: Mapping[str, ListedPlant]


class _Lists(Verbs):
    """Alone, it says what it can list."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        return super().parse_args(ctx, args or ["--help"])


@click.group("list", cls=_Lists)
def command() -> None:
    """List recorded runs, or what there is: scenarios, files, studies, controllers, plants, schemas."""


def recordings_in(folder: Path) -> list[Path]:
    """Return the recordings below a folder; a run's folder is one. Raises PlanError without a folder."""
    if not folder.is_dir():
        raise PlanError(f"{folder}: there is no such folder: give one with recordings")
    paths: dict[Path, None] = {}
    for path in sorted(folder.rglob("*.mcap")):
        bag = path.parent
        paths[bag if bag != folder and (bag / "metadata.yaml").is_file() else path] = None
    return list(paths)


def listed(path: Path, judge: bool = False) -> ListedRun:
    """Return the list's entry for a recording; one that cannot be read is listed, too.

    ``judge``: recompute it, as trunk verify does; otherwise it is unjudged.
    """
    from trunk_core.errors import TrunkError
    from trunk_evidence.run_table import RunTable, metrics

    try:
        run = open_run(path)
        provenance = run.recording.provenance
        doubts = doubts_of(run, twin=False)
    except (TrunkError, OSError) as error:
        return ListedRun(path, None, error=str(error))
    try:
        values = metrics(RunTable.from_run(run, only=("reference",))).as_dict()
    except (TrunkError, ValueError):
        values = {}
    return ListedRun(
        path,
        about(run, doubts, _verdict(path) if judge else None).doubts,
        provenance.get("started_utc") or None,
        provenance.get("scenario") or None,
        tuple(run.acting),
        run.mode or None,
        {name: values[name] for name in _SHOWN if name in values},
    )


def _verdict(path: Path) -> Word:
    from trunk_core.errors import TrunkError
    from trunk_evidence.verdict import Verdict

    from .verify import judged

    try:
        _, verdict = judged(path)
    except (TrunkError, OSError):
        return Verdict().word
    return verdict.word


@command.command("runs")
@click.argument("folder", type=click.Path(path_type=Path), default=Path())
@click.option("--verify", "judge", is_flag=True, help="Judge each run, as trunk verify does.")
@json_option(ListRunsResult)
@click.pass_context
def runs(ctx: click.Context, folder: Path, judge: bool, as_json: bool) -> None:
    """List the recordings below FOLDER (default: the current one), newest first, with their main metrics.

    FELL, LATE or INCOMPLETE before a run's numbers says why it is doubtful. Without --verify
    nothing is recomputed, and the verdict is "unjudged", also of runs that were verified before; with it, the
    exit code is 1 if a run diverges.
    """
    entries = [listed(path, judge) for path in recordings_in(folder)]
    entries.sort(key=lambda entry: entry.started or "", reverse=True)
    if as_json:
        write_json(ListRunsResult(entries))
    else:
        for entry in entries:
            if entry.error:
                named = entry.error.startswith(str(entry.file))
                click.echo(entry.error if named else f"{entry.file}: {entry.error}", err=True)
        _show(folder, [entry for entry in entries if not entry.error])
    ctx.exit(int(any(entry.verdict == "diverges" for entry in entries)))


def _show(folder: Path, entries: Sequence[ListedRun]) -> None:
    if not entries:
        click.echo(f"{folder}: no recordings")
        return
    print_table(
        f"recordings in {folder}",
        ("run", "scenario", "controller", "mode", "verdict", "doubts", *_SHOWN.values()),
        [
            (
                str(entry.file.relative_to(folder) if entry.file != folder else entry.file),
                entry.scenario or "",
                ", ".join(entry.controllers),
                entry.mode or "",
                entry.verdict,
                ", ".join(entry.words),
                *(_metric(entry, name) for name in _SHOWN),
            )
            for entry in entries
        ],
        texts=6,
    )


def _metric(run: ListedRun, name: str) -> str:
    if name not in run.metrics:
        return ""
    return number(run.metrics[name], 4)


@command.command("scenarios")
@json_option(ListFilesResult)
def scenarios(as_json: bool) -> None:
    """List the shipped scenarios: what happens in each; trunk list files has their paths."""
    from trunk_runs.scenario import SCENARIOS, shipped_files

    files = {name: path for name, path in shipped_files().items() if name in SCENARIOS}
    if as_json:
        _files(files, as_json)
        return
    rows = []
    for name, path in files.items():
        first, _, _ = path.read_text("utf-8").partition("\n")
        rows.append((name, first.removeprefix("# ")))
    click.echo("\n".join(aligned(rows)))


@command.command("files")
@json_option(ListFilesResult)
def parameter_files(as_json: bool) -> None:
    """List the shipped parameter files."""
    from trunk_runs.scenario import shipped_files

    _files(shipped_files(), as_json)


@command.command("studies")
@json_option(ListFilesResult)
def studies(as_json: bool) -> None:
    """List the shipped studies."""
    from trunk_studies.study import shipped_studies

    _files(shipped_studies(), as_json)


@command.command("schemas")
@json_option(ListSchemasResult)
@click.pass_context
def json_schemas(ctx: click.Context, as_json: bool) -> None:
    """List what verbs print with --json; with --json, the JSON Schema of each document."""
    known = schemas(ctx.find_root().command)
    if as_json:
        write_json(ListSchemasResult(known))
    else:
        click.echo("\n".join(aligned([(name, str(of["title"])) for name, of in known.items()])))


@command.command("controllers")
@json_option(ListControllersResult)
def controllers(as_json: bool) -> None:
    """List the controllers, with the commands that start them."""
    from trunk_control.laws import law_named
    from trunk_runs.nodes import CONTROLLERS, NODES

    if as_json:
        entries = {
            name: ListedController(
                law_named(name).label, ("ros2", "run", NODES[name].package, name)
            )
            for name in CONTROLLERS
        }
        write_json(ListControllersResult(entries))
        return
    rows = [
        (name, f"{law_named(name).label}: ros2 run {NODES[name].package} {name}")
        for name in CONTROLLERS
    ]
    click.echo("\n".join(aligned(rows)))


@command.command("plants")
@json_option(ListPlantsResult)
def plants(as_json: bool) -> None:
    """List the plants: the package of each, its coordinates, the one that the command pushes."""
    from trunk_core.plugins import PluginError
    from trunk_sim.plant import PLANTS

    entries: dict[str, ListedPlant] = {}
    for name in PLANTS.names:
        try:
            plant = PLANTS.named(name)
        except PluginError as error:
            show_warnings([f"{error}; the other plants can be used"])
            continue
        entries[name] = ListedPlant(
            plant.label,
            PLANTS.package_of(name),
            [ListedCoordinate(*coordinate) for coordinate in plant.coordinates],
            plant.driven.joint,
        )
    if as_json:
        write_json(ListPlantsResult(entries))
        return
    rows = []
    for name, entry in entries.items():
        moves = ", ".join(f"{joint} [{unit}]" for joint, unit in entry.coordinates)
        drive = f"{entry.drive} is pushed"
        rows.append((name, f"{entry.label} ({entry.package}): {moves}; {drive}"))
    click.echo("\n".join(aligned(rows)))


def _files(paths: Mapping[str, Path], as_json: bool) -> None:
    if as_json:
        write_json(ListFilesResult(paths))
    else:
        click.echo("\n".join(aligned([(name, str(path)) for name, path in paths.items()])))
