"""``trunk export-c``: a controller with its parameters as C, equal to the last bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_control.law import ControllerConfig
from trunk_control.laws import law_named
from trunk_core.errors import PlanError
from trunk_core.files import atomic_write
from trunk_core.parameters.declarations import values_of
from trunk_core.parameters.parameter_files import Layer, Section, check_names, read
from trunk_core.results import Keyword, Result
from trunk_core.text import shell_words
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.provenance import ARITHMETIC
from trunk_runs.nodes import declared_names
from trunk_runs.plan import suspicious_units
from trunk_runs.scenario import config_from, find_file, parse_setting

from ..console.document import json_option, write_json
from ..console.options import (
    ControllerName,
    check_folder,
    check_not_read,
    output_options,
    parameter_options,
)
from ..console.reading import open_run
from ..console.terminal import show_warnings

_DIGEST = Keyword("pattern", "^[0-9a-f]{16}$")
_SOME = Keyword("minimum", 1)


@dataclass(frozen=True)
class ExportCResult(Result, document="export-c-1"):
    """The document of ``trunk export-c``."""

    controller: str
    name: Annotated[str, "In C: --name, or the controller"]
    folder: Path
    files: Annotated[list[Path], Keyword("minItems", 4)]
    parameters: Annotated[str, _DIGEST, "Their digest"]
    sources: Annotated[str, _DIGEST, "Fingerprint of the Python files that were translated"]
    arithmetic: str
    retunable: Annotated[list[str], "Parameters that may change on the target"]
    states: Annotated[int, _SOME, "That replay.c answers"]
    commands: Annotated[int, _SOME, "That it compares"]
    answered_by: Annotated[str, "The recording, or CPython"]
    compile: Annotated[list[str], "The words of a command"]
    replay: Annotated[list[str], "The words of a command"]


@click.command("export-c")
@click.argument("controller", type=ControllerName())
@parameter_options
@output_options(
    "The folder to write; it is made.",
    required=True,
    force="Also into a folder with files; those of the same names are replaced.",
)
@click.option(
    "--like",
    type=click.Path(path_type=Path),
    metavar="RUN.mcap",
    help="Replay this recording's states and commands; its parameters come before --params and --set.",
)
@click.option(
    "--name", help="The name in C, of functions, files and targets; by default CONTROLLER."
)
@json_option(ExportCResult)
def command(
    controller: str,
    params: tuple[str, ...],
    settings: tuple[str, ...],
    output: Path,
    force: bool,
    like: Path | None,
    name: str | None,
    as_json: bool,
) -> None:
    """Write CONTROLLER with its parameters as C99: every command has the bits that it has in Python.

    Without --params, --set and --like its parameters are the defaults.
    """
    from ..export_c.library import (
        SWINGING,
        ExportedController,
        base_files,
        check_name,
        recorded_rows,
    )

    name = check_name(controller if name is None else name)
    check_folder(output, force)
    run = None if like is None else open_run(like)
    config = _config(controller, params, settings, run)
    exported = ExportedController(law_named(controller), config, name)
    rows = exported.answers(SWINGING) if run is None else recorded_rows(run, exported)
    if run is not None and not any(row.compared for row in rows):
        raise PlanError(f"--like {like}: it has no commands of {controller}: give a whole run")
    origin = "CPython" if run is None else run.path.name
    written = _written(output, base_files(exported, rows), [*params, *([like] if like else [])])
    source = output / f"{name}.c"
    words = ["cc", "-std=c99", "-O2", source, output / "replay.c", "-o", output / "replay"]
    compile_command = [str(word) for word in words]
    run_command = [str(_runnable(output / "replay")), str(output / f"{name}.states")]
    compared = sum(row.compared for row in rows)
    if as_json:
        result = ExportCResult(
            controller,
            name,
            output,
            written,
            exported.digest,
            exported.fingerprint,
            ARITHMETIC,
            [leaf.declaration.name for leaf in exported.leaves],
            len(rows),
            compared,
            origin,
            compile_command,
            run_command,
        )
        write_json(result)
        return
    for path in written:
        click.echo(path)
    click.echo(f"to compare {compared} commands, answered by {origin}, bit by bit:")
    click.echo(f"  {shell_words(*compile_command)} && {shell_words(*run_command)}")


def _config(
    name: str, params: Sequence[str], settings: Sequence[str], run: RecordedRun | None
) -> ControllerConfig:
    """Return the controller's configuration: the recording's, then files, then single values."""
    given = [read(find_file(file)) for file in params]
    given += [parse_setting(setting) for setting in settings]
    check_names(given, declared_names())
    for layer in given:  # a robot must not get defaults by mistake
        if not any(section.matches(f"/{name}") for section in layer.sections):
            nodes = ", ".join(dict.fromkeys(section.pattern for section in layer.sections))
            raise PlanError(
                f"{layer.source}: nothing in it is for {name}: it is for {nodes or 'no node'}; "
                f"give parameters of {name}"
            )
    if run is not None and name in run.parameters:
        recorded = Section(name, dict(values_of(run.config(name))))
        given.insert(0, Layer(str(run.path), (recorded,)))
    resolved = config_from(name, given, "")
    show_warnings(suspicious_units({name: resolved.config}, {name: resolved.with_units}))
    config: ControllerConfig = resolved.config
    return config


def _runnable(path: Path) -> Path | str:
    return path if path.is_absolute() or len(path.parts) > 1 else f"./{path}"


def _written(folder: Path, texts: dict[str, bytes], inputs: Sequence[str | Path]) -> list[Path]:
    """Write files into a folder. Raises PlanError, before any is written, over what the verb reads."""
    paths = [folder / name for name in texts]
    for path in paths:
        check_not_read(path, inputs)
    for path, text in zip(paths, texts.values(), strict=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as part:
            part.write_bytes(text)
    return paths
