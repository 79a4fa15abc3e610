"""Where rich prints: colours and bars bypass the filter that all other text goes through."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TextIO

import click

from trunk_msgs_util.text import PrintableStream, printable

if TYPE_CHECKING:
    from rich.console import Console


def console(stderr: bool = False) -> Console:
    """Return a console for stdout or stderr; text from elsewhere has to be made `printable` first."""
    from rich.console import Console

    return Console(file=_unfiltered(sys.stderr if stderr else sys.stdout))


def print_title(title: str) -> None:
    """Print a title, bold on terminals, and an empty line."""
    click.secho(f"{printable(title)}\n", bold=True, file=_unfiltered(sys.stdout))


def _unfiltered(stream: TextIO) -> TextIO:
    return stream.stream if isinstance(stream, PrintableStream) else stream
