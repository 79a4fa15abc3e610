"""``trunk list``: the runs in a folder, and what is shipped, each with its path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from ..analysis.metrics import missing
from ..console.document import json_option, schemas, write_json
from ..console.reading import open_run
from ..console.tables import aligned, print_table
from ..console.verbs import Verbs
from ..errors import PlanError

if TYPE_CHECKING:
    from ..replay.doubts import Doubts

# Column headings of the metrics by which docs/paper.md judges.
_SHOWN = {
    "overshoot_deg": "overshoot, °",
    "settling_time_6deg_s": "settles ±6°, s",
    "steady_state_error_mean_deg": "mean, °",
    "steady_state_error_rms_deg": "RMS, °",
    "iae": "IAE",
}
UNJUDGED = "unjudged"  # not recomputed here, whoever verified it before
_REFUTED = ("diverges", "not signed")  # words of a verdict


class ListedRun(NamedTuple):
    """A recording in a folder."""

    path: Path
    started: str  # UTC; empty if unknown
    scenario: str
    controllers: tuple[str, ...]
    mode: str
    verdict: str  # of trunk verify, or UNJUDGED
    doubts: Doubts | None  # None: it cannot be read
    metrics: dict[str, float | None]  # empty if there are none
    error: str = ""

    @property
    def words(self) -> tuple[str, ...]:
        """What makes it doubtful: FELL, LATE, INCOMPLETE."""
        return tuple(line.split(":")[0] for line in self.doubts.lines) if self.doubts else ()

    def as_values(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        judged = None if self.verdict == UNJUDGED else self.verdict
        return {
            "file": self.path,
            "doubts": None if self.doubts is None else self.doubts.as_values(judged),
            "started": self.started or None,
            "scenario": self.scenario or None,
            "controllers": self.controllers,
            "mode": self.mode or None,
            "metrics": self.metrics,
            "error": self.error or None,
        }


@click.group("list", cls=Verbs)
def command() -> None:
    """List recorded runs, or what is shipped: scenarios, files, studies, controllers, schemas."""


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
    from trunk_msgs_util.errors import TrunkError

    from ..analysis.metrics import metrics
    from ..analysis.run_table import RunTable
    from ..replay.doubts import doubts_of

    try:
        run = open_run(path)
        provenance = run.recording.provenance
        doubts = doubts_of(run, twin=False)
    except (TrunkError, OSError) as error:
        return ListedRun(path, "", "", (), "", "", None, {}, str(error))
    try:
        values = metrics(RunTable.from_run(run, only=("reference",))).as_dict()
    except (TrunkError, ValueError):
        values = {}
    return ListedRun(
        path,
        provenance.get("started_utc", ""),
        provenance.get("scenario", ""),
        tuple(run.acting),
        run.mode,
        _verdict(path) if judge else UNJUDGED,
        doubts,
        {name: values[name] for name in _SHOWN if name in values},
    )


def _verdict(path: Path) -> str:
    from trunk_msgs_util.errors import TrunkError

    from ..replay.verdict import Verdict
    from .verify import judged

    try:
        _, verdict = judged(path, None, None)
    except (TrunkError, OSError):
        return Verdict().word
    return verdict.word


@command.command("runs")
@click.argument("folder", type=click.Path(path_type=Path), default=Path())
@click.option("--verify", "judge", is_flag=True, help="Judge each run, as trunk verify does.")
@json_option("list-runs-1")
@click.pass_context
def runs(ctx: click.Context, folder: Path, judge: bool, as_json: bool) -> None:
    """List the recordings below FOLDER (default: the current one), newest first, with their main metrics.

    FELL, LATE or INCOMPLETE before a run's numbers says why it is doubtful. Without --verify
    nothing is recomputed, and the verdict is "unjudged", also of runs that were verified before; with it, the
    exit code is 1 if a run diverges.
    """
    entries = [listed(path, judge) for path in recordings_in(folder)]
    entries.sort(key=lambda entry: entry.started, reverse=True)
    if as_json:
        write_json("list-runs-1", {"runs": [entry.as_values() for entry in entries]})
    else:
        for entry in entries:
            if entry.error:
                named = entry.error.startswith(str(entry.path))
                click.echo(entry.error if named else f"{entry.path}: {entry.error}", err=True)
        _show(folder, [entry for entry in entries if not entry.error])
    ctx.exit(int(any(entry.verdict in _REFUTED for entry in entries)))


def _show(folder: Path, entries: Sequence[ListedRun]) -> None:
    if not entries:
        click.echo(f"{folder}: no recordings")
        return
    print_table(
        f"recordings in {folder}",
        ("run", "scenario", "controller", "mode", "verdict", "doubts", *_SHOWN.values()),
        [
            (
                str(entry.path.relative_to(folder) if entry.path != folder else entry.path),
                entry.scenario,
                ", ".join(entry.controllers),
                entry.mode,
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
    value = run.metrics[name]
    return missing(name) if value is None else f"{value:.4g}"


@command.command("scenarios")
@json_option("list-files-1")
def scenarios(as_json: bool) -> None:
    """List the shipped scenarios: what happens in each; trunk list files has their paths."""
    from ..plans.files import SCENARIOS, shipped_files

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
@json_option("list-files-1")
def parameter_files(as_json: bool) -> None:
    """List the shipped parameter files."""
    from ..plans.files import shipped_files

    _files(shipped_files(), as_json)


@command.command("studies")
@json_option("list-files-1")
def studies(as_json: bool) -> None:
    """List the shipped studies."""
    from ..study.study import shipped_studies

    _files(shipped_studies(), as_json)


@command.command("schemas")
@json_option("list-files-1")
def json_schemas(as_json: bool) -> None:
    """List the JSON Schemas of what verbs print with --json."""
    _files(schemas(), as_json)


@command.command("controllers")
@json_option("list-controllers-1")
def controllers(as_json: bool) -> None:
    """List the controllers, with the commands that start them."""
    from trunk_control.laws import law_named

    from ..plans.nodes import CONTROLLERS, NODES

    if as_json:
        entries = {
            name: {
                "label": law_named(name).label,
                "command": ["ros2", "run", NODES[name].package, name],
            }
            for name in CONTROLLERS
        }
        write_json("list-controllers-1", {"controllers": entries})
        return
    rows = [
        (name, f"{law_named(name).label}: ros2 run {NODES[name].package} {name}")
        for name in CONTROLLERS
    ]
    click.echo("\n".join(aligned(rows)))


def _files(paths: Mapping[str, Path], as_json: bool) -> None:
    if as_json:
        write_json("list-files-1", {"files": paths})
    else:
        click.echo("\n".join(aligned([(name, str(path)) for name, path in paths.items()])))
