"""Lines at a terminal: errors and warnings on stderr, titles, and where rich prints."""

from __future__ import annotations

import errno
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, TextIO

import click

from trunk_msgs_util.errors import EXIT_USAGE, TrunkError
from trunk_msgs_util.text import PrintableStream, bounded, printable

if TYPE_CHECKING:
    from rich.console import Console

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
