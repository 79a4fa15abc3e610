"""What a verb writes for programs: one JSON document on stdout, a `Result`; see docs/metrics.md."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Annotated, Any, TextIO

import click

from trunk_core.files import stream_writer
from trunk_core.results import Keyword, Result, document, schema

OPTION = "--json"
_STDOUT = 1
_stream: ContextVar[TextIO | None] = ContextVar("document", default=None)


@dataclass(frozen=True)
class ErrorResult(Result, document="error-1"):
    """Why there is no result: any verb."""

    error: Annotated[str, "The line that is on stderr"]
    exit_code: Annotated[int, "The process's", Keyword("minimum", 1)]


class JsonOption(click.Option):
    """``--json``; ``documents``: what the verb then writes, besides an `ErrorResult`."""

    def __init__(
        self, *args: Any, documents: tuple[type[Result] | str, ...], **kwargs: Any
    ) -> None:
        super().__init__(*args, **kwargs)
        self._documents = documents

    @property
    def documents(self) -> tuple[type[Result], ...]:
        """The documents' classes."""
        return tuple(
            resolve_name(kind) if isinstance(kind, str) else kind for kind in self._documents
        )


def json_option(*documents: type[Result] | str) -> Callable[[Any], Any]:
    """Return the option ``--json`` of a verb that then writes one of these documents.

    Of a module that takes long to load, the class is named as ``study.robustness:LimitResult``.
    """
    return click.option(
        OPTION,
        "as_json",
        is_flag=True,
        cls=JsonOption,
        documents=documents,
        help="Print one JSON document; for its schema: trunk list schemas.",
    )


def json_asked() -> bool:
    """Return True if the command line asks for JSON, even if the rest of it is wrong."""
    words = sys.argv[1:]
    return OPTION in words[: words.index("--")] if "--" in words else OPTION in words


def write_json(result: Result) -> None:
    """Print a result's document."""
    click.echo(json.dumps(document(result), indent=2, allow_nan=False), file=_stream.get())


@contextmanager
def documents_alone() -> Iterator[None]:
    """If JSON is asked for, let nothing but documents reach stdout: all else goes to stderr.

    This includes what libraries such as Fast DDS print past Python's streams, and what child processes print.
    """
    if not json_asked():
        yield
        return
    out, err = sys.stdout, sys.stderr
    own = _moved(out, err)
    token = _stream.set(own or out)
    sys.stdout = err
    try:
        yield
    finally:
        sys.stdout = out
        _stream.reset(token)
        if own is not None:
            os.dup2(own.fileno(), _STDOUT)
            with suppress(OSError):  # its reader is gone, or its disk is full
                own.close()


def _moved(out: TextIO, err: TextIO) -> TextIO | None:
    """Send the process's stdout to stderr and return the original; None if ``out`` is not that stdout."""
    try:
        if (out.fileno(), err.fileno()) != (_STDOUT, 2):
            return None
    except (AttributeError, OSError):  # a test's, or closed
        return None
    out.flush()
    own = stream_writer(os.dup(_STDOUT), encoding="ascii")
    os.dup2(2, _STDOUT)
    return own


def schemas(root: click.Command) -> dict[str, dict[str, object]]:
    """Return the JSON Schemas of what a command and those below it write, by document."""
    kinds: set[type[Result]] = {ErrorResult}
    waiting = [(root, click.Context(root))]
    while waiting:
        command, context = waiting.pop()
        for option in command.params:
            kinds |= {*option.documents} if isinstance(option, JsonOption) else set()
        if isinstance(command, click.Group):
            for name in command.list_commands(context):
                below = command.get_command(context, name)
                if below is not None:
                    waiting.append((below, click.Context(below, parent=context, info_name=name)))
    return {kind.document: schema(kind) for kind in sorted(kinds, key=lambda kind: kind.document)}
