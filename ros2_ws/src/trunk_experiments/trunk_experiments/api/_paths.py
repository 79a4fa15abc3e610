"""Paths as callers give them, and the one rule for what is written."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..errors import PlanError

AnyPath = str | os.PathLike[str]


def path_of(value: AnyPath, what: str) -> Path:
    """Return a path. Raises PlanError, naming what it is for, if the value is none."""
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):
        raise PlanError(f"{what} {value!r} is not a path: give a text or a pathlib.Path")
    return Path(value)


def output_path(
    value: AnyPath, suffixes: Sequence[str], overwrite: bool, inputs: Iterable[Path] = ()
) -> Path:
    """Return a file that may be written.

    Raises PlanError for one that exists, unless ``overwrite``, for one of the ``inputs``, for another suffix
    and for a folder that is not there.
    """
    from ..console.outputs import check_output

    path = path_of(value, "output")
    with writing(path):
        if path.exists() and not path.is_dir() and not overwrite:
            raise PlanError(f"output {path}: it exists: give another name, or overwrite=True")
        return check_output(path, suffixes, True, inputs, "output")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says while a file is written into a PlanError that names the file."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise PlanError(f"output {path}: {reason}: give another place") from None
