"""Progress of some work, on stderr: a bar on a terminal, otherwise a few plain lines if it takes long."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from trunk_msgs_util.text import printable

from .terminal import console

_PER_LINE = 10  # percent


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
