"""Paths as callers give them, and the one rule for output files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..errors import PlanError

AnyPath = str | os.PathLike[str]


def path_of(value: AnyPath, subject: str) -> Path:
    """Return a path. Raises PlanError, naming what it is for, if the value is not a path."""
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):
        raise PlanError(f"{subject} {value!r} is not a path: give a string or a pathlib.Path")
    return Path(value)


def output_path(
    value: AnyPath, suffixes: Sequence[str], overwrite: bool, inputs: Iterable[Path] = ()
) -> Path:
    """Return the path of a file that may be written.

    Raises PlanError for a file that exists, unless ``overwrite``, for one of the ``inputs``, for any other
    suffix and for a folder that does not exist.
    """
    from ..console.outputs import check_output

    path = path_of(value, "output")
    with writing(path):
        if path.exists() and not path.is_dir() and not overwrite:
            raise PlanError(f"output {path}: it exists: give another name, or overwrite=True")
        return check_output(path, suffixes, True, inputs, "output")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError from writing a file into a PlanError that names the file."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise PlanError(f"output {path}: {reason}: give another place") from None
