"""What a verb writes: one rule for all of them, checked before any work.

Never over an input, whatever the options; over an existing file only with ``--force``; only with an allowed
suffix; only into a folder that exists.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import click

from trunk_msgs_util.files import will_write

from ..errors import PlanError
from ..recorded.name import name_of_run
from ..results import Result
from .document import json_asked

_STDOUT = (Path("/dev/stdout"), Path("/dev/fd/1"))
FORCE = "Replace the file if it exists."


@dataclass(frozen=True)
class OutputResult(Result):
    """What documents of verbs that write one file begin with."""

    output: Annotated[Path, "The file that is written"]


def output_options(text: str, required: bool = False, force: str = FORCE) -> Callable[[Any], Any]:
    """Return a decorator that adds ``-o, --output FILE``, described as ``what``, and ``--force``."""

    def add(function: Any) -> Any:
        function = click.option("--force", is_flag=True, help=force)(function)
        return click.option(
            "-o",
            "--output",
            type=click.Path(path_type=Path),
            required=required,
            help=text,
        )(function)

    return add


def check_output(
    path: Path,
    suffixes: Sequence[str] = (),
    force: bool = False,
    inputs: Iterable[str | Path] = (),
    option: str = "--output",
    chooses_format: bool = False,
) -> Path:
    """Return an output; refuse, before any work, one that must not or cannot be written.

    ``suffixes``: what its name may end in; empty: anything. ``force``: a file that exists is replaced.
    ``inputs``: what the verb reads; names that are not files are ignored. /dev/stdout and the like are
    written to, except where the suffix ``chooses_format``. Raises PlanError.
    """
    place = f"{option} {path}"
    if is_stream(path) and not chooses_format:
        if json_asked() and path in _STDOUT:
            raise PlanError(f"{place}: with --json the document goes there: name a file")
        return path
    if path.is_dir():
        raise PlanError(f"{place}: it is a folder: name a file")
    if suffixes and path.suffix.lower() not in suffixes:
        allowed = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise PlanError(f"{place}: the file's name must end in {allowed}")
    folder = path.parent
    if not folder.exists():
        raise PlanError(f"{place}: there is no folder {folder}: make it, or give another")
    if not folder.is_dir():
        raise PlanError(f"{place}: {folder} is not a folder: give another")
    if not os.access(folder, os.W_OK):
        raise PlanError(f"{place}: {folder} cannot be written to: give another")
    if path.exists():
        check_not_read(path, inputs, option)
        if not force:
            raise PlanError(f"{place}: it exists: give another name, or --force")
    will_write(path, overwrite=force)
    return path


def is_stream(path: Path) -> bool:
    """Return True for what is not a regular file, such as /dev/stdout."""
    return path.is_relative_to("/dev") and not path.is_relative_to("/dev/shm")


def check_not_read(path: Path, inputs: Iterable[str | Path], option: str = "--output") -> None:
    """Refuse to overwrite what the verb reads, whatever the options. Raises PlanError."""
    for source in inputs:
        if _is_same(path, Path(source)):
            raise PlanError(
                f"{option} {path}: it is read by this command ({source}): give another name"
            )


def check_folder(path: Path, force: bool = False, option: str = "--output") -> Path:
    """Return a folder for results; refuse one that is not empty, unless ``force``.

    Raises PlanError.
    """
    if path.exists() and not path.is_dir():
        raise PlanError(f"{option} {path}: it is not a folder: give another")
    if path.is_dir() and not force and any(path.iterdir()):
        raise PlanError(f"{option} {path}: the folder is not empty: give another, or --force")
    return path


def default_name(run: Path, suffix: str) -> Path:
    """Return a verb's default output: in the current folder, named after a run's folder or file.

    ``fig8/run.mcap`` and ``fig8`` give ``fig8.png``; ``mine.mcap`` gives ``mine.png``.
    """
    return Path(f"{name_of_run(run) or 'run'}{suffix}")


def _is_same(path: Path, other: Path) -> bool:
    """Return True if ``other`` is the file, or a folder with a recording that is."""
    try:
        recordings = other.glob("*.mcap") if other.is_dir() else [other]
        return any(path.samefile(recording) for recording in recordings)
    except OSError:  # a name that is not a file: a scenario's, a shipped file's
        return False
