"""Paths without links, and files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PARTS: set[Path] = set()  # that are being written
_NEW: set[Path] = set()  # that are to replace nothing


def will_write(path: Path, *, overwrite: bool) -> None:
    """Say, before the work begins, whether `atomic_write` may replace what has the name at its end."""
    (_NEW.discard if overwrite else _NEW.add)(resolve_path(path))


@contextmanager
def atomic_write(path: Path, *, overwrite: bool | None = None) -> Iterator[Path]:
    """Yield a name to write to; what is written there becomes ``path`` when the block ends.

    Whatever happens in the block (a full disk, an exception, kill -9), ``path`` stays as it was. Anything
    but a regular file, such as /dev/stdout, is written to directly. ``overwrite``: None for what `will_write`
    was told, else True. Raises OSError that names ``path``, and FileExistsError if it exists, unless
    ``overwrite``; if it was made during the block, what the block wrote gets another name.
    """
    target = resolve_path(path)
    if overwrite is None:
        overwrite = target not in _NEW
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists: choose another name, or --force")
    part = path
    try:
        if path.exists() and not path.is_file():
            yield path
            return
        part = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
        _PARTS.add(part)
        yield part
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        _put(part, target, overwrite)
    except OSError as error:
        if error.filename not in (None, part, str(part)):
            raise
        if error.errno is None:
            raise OSError(f"{path}: {error}") from None
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from None
    finally:
        _NEW.discard(target)
        if part is not path:
            _discard(part)


def _put(part: Path, target: Path, overwrite: bool) -> None:
    """Give a complete file its name. Raises FileExistsError if another file has it, unless ``overwrite``."""
    if not overwrite:
        try:
            os.link(part, target)
            return
        except OSError:  # FileExistsError, or the file system has no links
            if target.exists():
                kept = part.rename(part.with_name(part.name[1:]))
                text = f"another command has written it meanwhile; this result is in {kept}"
                raise FileExistsError(text) from None
    part.replace(target)


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
