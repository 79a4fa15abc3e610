"""What a verb writes for programs: one JSON document on stdout, whose name has a version.

The schemas are in ``schemas/NAME.json`` of this package; docs/metrics.md says what is promised.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from math import isfinite, isnan
from pathlib import Path
from typing import Any, TextIO

import click

from trunk_msgs_util.streams import writer

OPTION = "--json"
ERROR = "error-1"
_STDOUT = 1
_stream: ContextVar[TextIO | None] = ContextVar("document", default=None)


class JsonOption(click.Option):
    """``--json``; ``documents``: the names of what the verb then writes, besides `ERROR`."""

    def __init__(self, *args: Any, documents: tuple[str, ...], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.documents = documents


def json_option(*documents: str) -> Callable[[Any], Any]:
    """Return the option ``--json`` of a verb that then writes one of these documents."""
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


def write_json(name: str, values: Mapping[str, object]) -> None:
    """Print a document; ``name`` is its schema's, such as ``metrics-1``."""
    document = {"schema": f"trunk/{name}", **values}
    click.echo(json.dumps(plain(document), indent=2, allow_nan=False), file=_stream.get())


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
    own = writer(os.dup(_STDOUT), encoding="ascii")
    os.dup2(2, _STDOUT)
    return own


def plain(value: object) -> object:
    """Return a value as JSON has it: paths and the numbers that JSON lacks become strings.

    NaN and the infinities are ``"NaN"``, ``"Infinity"`` and ``"-Infinity"``, as Python's ``float`` and
    JavaScript's ``Number`` read them; None (null) only ever means that there is no value.
    """
    if isinstance(value, float) and not isfinite(value):
        return "NaN" if isnan(value) else "Infinity" if value > 0.0 else "-Infinity"
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def schemas() -> dict[str, Path]:
    """Return the files of the shipped JSON Schemas by their names."""
    from importlib.resources import files

    folder = Path(str(files("trunk_experiments").joinpath("schemas")))
    return {path.stem: path for path in sorted(folder.glob("*.json"))}
