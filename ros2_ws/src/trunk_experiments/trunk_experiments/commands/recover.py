"""``trunk recover``: a valid file from a broken one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_core.results import Count, Named, Result
from trunk_recording.bag_folder import bag_folder
from trunk_recording.reader import RecordingError
from trunk_recording.repair import recover

from ..console.document import json_option, write_json
from ..console.options import check_output, output_options
from ..console.reading import WrittenResult, about_written


@dataclass(frozen=True)
class _Recovered(Result):
    """What a recording was recovered from."""

    broken: Annotated[Path, Named("from"), "The broken file"]


@dataclass(frozen=True)
class RecoverResult(WrittenResult, _Recovered, document="recover-1"):
    """The document of ``trunk recover``."""

    messages: Annotated[Mapping[str, Count], "Saved, by topic"]
    lost: Annotated[Sequence[str], "Empty: nothing"]


@click.command("recover")
@click.argument("broken", type=click.Path(path_type=Path, exists=True))
@output_options("The MCAP file to write.", required=True)
@json_option(RecoverResult)
@click.pass_context
def command(context: click.Context, broken: Path, output: Path, force: bool, as_json: bool) -> None:
    """Write a finished, indexed file with everything that can be read from a broken one.

    The new file is marked as recovered and never passes for a complete run.

    Exit code: 0 nothing was lost, 1 something was lost, 2 nothing can be read.
    """
    broken = _file_of(broken)
    check_output(output, (".mcap",), force, [broken])
    recovery = recover(broken, output, force)
    if as_json:
        written = vars(about_written(output))
        write_json(RecoverResult(broken, **written, **vars(recovery)))
    else:
        for line in recovery.lost:
            click.echo(f"lost: {line}")
        click.echo(f"{output}: {recovery.count} messages of {len(recovery.messages)} topics")
    context.exit(1 if recovery.lost else 0)


def _file_of(broken: Path) -> Path:
    """Return the file itself, or that of a bag. Raises RecordingError for a bag of several."""
    if not broken.is_dir():
        return broken
    files = bag_folder(broken).files
    if len(files) > 1:
        names = ", ".join(path.name for path in files[:8]) + (", ..." if len(files) > 8 else "")
        raise RecordingError(f"{broken} has {len(files)} files: recover each of them: {names}")
    return files[0]
