"""Paths without links, and files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PARTS: set[Path] = set()  # that are being written


@contextmanager
def atomic_write(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Yield a name to write to; what is written there becomes ``path`` when the block ends.

    Whatever happens in the block (a full disk, an exception, kill -9), ``path`` stays as it was. Anything
    but a regular file, such as /dev/stdout, is written to directly. Raises OSError that names ``path``,
    and FileExistsError if it exists, unless ``overwrite``.
    """
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists: choose another name, or --force")
    part = path
    try:
        if path.exists() and not path.is_file():
            yield path
            return
        target = resolve_path(path)
        part = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
        _PARTS.add(part)
        yield part
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.replace(target)
    except OSError as error:
        if error.filename not in (None, part, str(part)):
            raise
        if error.errno is None:
            raise OSError(f"{path}: {error}") from None
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from None
    finally:
        if part is not path:
            _discard(part)


def discard_parts() -> None:
    """Delete files that are not complete yet, in a process that is about to exit."""
    for part in list(_PARTS):
        _discard(part)


def _discard(part: Path) -> None:
    with suppress(OSError):
        part.unlink()
    _PARTS.discard(part)


def resolve_path(path: Path) -> Path:
    """Return a path without links and dots; as far as it goes, for a link that leads to itself."""
    return Path(os.path.realpath(path))
