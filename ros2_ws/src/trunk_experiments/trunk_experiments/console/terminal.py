"""Lines at a terminal: errors and warnings on stderr, titles, where rich prints, and progress.

Progress is on stderr: a bar on a terminal, otherwise a few plain lines if the work takes long.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TextIO

import click

from trunk_core.errors import EXIT_USAGE, TrunkError
from trunk_core.text import PrintableStream, bounded, printable

if TYPE_CHECKING:
    from rich.console import Console

_PER_LINE = 10  # percent
_ELSEWHERE = ": give a writable place"
_ADVICE = {
    errno.ENOSPC: ": free some space, or give another place",
    errno.EDQUOT: ": free some space, or give another place",
    errno.EROFS: _ELSEWHERE,
    errno.EACCES: _ELSEWHERE,
    errno.EPERM: _ELSEWHERE,
    errno.ENOTDIR: ": part of this path is a file; give another place",
}


def line_of(error: Exception) -> str:
    """Return an error as one line that says what to do, of bounded length."""
    text = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename}: {error.strerror}{_ADVICE.get(error.errno or 0, '')}"
    return _line(text)


def _line(text: str) -> str:
    return bounded(printable(" ".join(text.split())))


def print_error(text: str) -> str:
    """Print a mistake to stderr; return it as one line."""
    line = _line(text)
    print(f"trunk: error: {line}", file=sys.stderr)
    return line


def report_error(error: TrunkError | OSError) -> int:
    """Print an error to stderr; return the exit code."""
    print_error(line_of(error))
    return error.exit_code if isinstance(error, TrunkError) else EXIT_USAGE


def show_warnings(texts: Iterable[str]) -> None:
    """Print warnings to stderr, a line each."""
    for text in texts:
        click.echo(f"trunk: warning: {_line(text)}", err=True)


def console(stderr: bool = False) -> Console:
    """Return rich's console for stdout or stderr; its colours and bars bypass the filter of all other text.

    Text from elsewhere has to be made `printable` first.
    """
    from rich.console import Console

    return Console(file=_unfiltered(sys.stderr if stderr else sys.stdout))


def print_title(title: str) -> None:
    """Print a title, bold on terminals, and an empty line."""
    click.secho(f"{printable(title)}\n", bold=True, file=_unfiltered(sys.stdout))


def _unfiltered(stream: TextIO) -> TextIO:
    return stream.stream if isinstance(stream, PrintableStream) else stream


def open_page(address: str) -> bool:
    """Open a page in a browser; False without a screen: a text browser would take over the terminal."""
    import webbrowser

    screen = (
        sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    return bool(screen) and webbrowser.open(address)


class Tell(Protocol):
    """Takes the amount done, the total, and a note."""

    def __call__(self, done: float, of: float, note: str = "") -> None: ...


@contextmanager
def progress_bar(title: str, lines_from: float = 0.0) -> Iterator[Tell]:
    """Yield a function to call with the amount done and the total.

    Where stderr is not a terminal, work of at least ``lines_from`` (in the unit of the amounts) prints a
    line for each tenth.
    """
    title = printable(title)
    if not _on_terminal():
        yield _Lines(title, lines_from)
        return
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    screen = console(stderr=True)
    columns = (
        TextColumn(title),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[note]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task(title, total=None, note="")
        yield lambda done, of, note="": bar.update(task, completed=done, total=of, note=note)


@contextmanager
def steps_told() -> Iterator[Callable[[str], None]]:
    """Yield a function to call with the name of each next step of some work."""
    if not _on_terminal():
        yield lambda step: _say(f"trunk: {printable(step)}")
        return
    with console(stderr=True).status("") as status:
        yield lambda step: status.update(printable(step))


def _on_terminal() -> bool:
    return sys.stderr.isatty()


class _Lines:
    """Prints a line whenever another tenth is done."""

    def __init__(self, title: str, lines_from: float) -> None:
        self._title, self._from, self._percent = title, lines_from, 0

    def __call__(self, done: float, of: float, note: str = "") -> None:
        if of <= 0.0 or of < self._from:
            return
        percent = int(100.0 * done / of)
        if percent // _PER_LINE > self._percent // _PER_LINE:
            self._percent = percent
            more = f", {note}" if note else ""
            _say(f"trunk: {self._title}: {percent} %{more}")


def _say(line: str) -> None:
    """Write a line to stderr at once: a signal must not come between it and its end."""
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
