"""Opening a recording for a verb: a progress bar on terminals, and warnings."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from trunk_msgs_util.printable import printable
from trunk_msgs_util.recording.reader import Recording

from ..recorded.run import RecordedRun
from .terminal import console

if TYPE_CHECKING:
    from ..views.run_view import RunView

Tell = Callable[[int, int], None]


@contextmanager
def progress_bar(what: str) -> Iterator[Tell]:
    """Yield a function to call with the amount done and the total; a bar only on terminals."""
    if not sys.stderr.isatty():
        yield lambda _done, _of: None
        return
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    what = printable(what)
    screen = console(stderr=True)
    columns = (TextColumn(what), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)
    with bar:
        task = bar.add_task(what, total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


def open_run(path: Path) -> RecordedRun:
    """Open a recorded run. Raises RecordingError."""
    with progress_bar(f"reading {path.resolve().name}") as tell:
        return RecordedRun(Recording.open(path, tell))


def open_views(paths: Iterable[Path]) -> list[RunView]:
    """Open runs that are to be shown. Raises RecordingError."""
    from ..views.run_view import RunView

    return [RunView.read(open_run(path)) for path in paths]


def show_damage(run: RecordedRun, name: str = "") -> None:
    """Print to stderr that a run is not whole, first, and what is damaged; ``name``: what to say it of."""
    from ..replay.doubts import incomplete

    show_warnings(f"{name}{line}" for line in (*incomplete(run), *run.recording.further_warnings))


def show_warnings_of(views: Iterable[RunView]) -> None:
    """Print what cannot be shown of runs to stderr."""
    for view in views:
        show_warnings(f"{view.path}: {warning}" for warning in view.warnings)


def show_warnings(warnings: Iterable[str]) -> None:
    """Print warnings to stderr."""
    for warning in warnings:
        click.echo(f"trunk: warning: {warning}", err=True)
