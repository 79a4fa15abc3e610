"""Paths without links, files that appear complete or not at all, and the three standard streams.

The streams of a program are open, and written to without harm when their reader has left. Without this, a
program that is started with a closed stream (``>&-``) fails at its first line, or its next file or socket
takes the stream's descriptor and receives what is printed.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn, TextIO

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


class _ForLeavingReaders(io.FileIO):
    """A descriptor that drops what nobody reads any more, so that ``| head`` changes no exit code.

    So is what a full disk keeps of stderr: there is no other place to say it. Of stdout, an error names it.
    """

    def write(self, data: Any, /) -> int:  # any buffer
        try:
            return super().write(data)
        except OSError as error:
            if not (isinstance(error, BrokenPipeError) or self.name == 2):
                raise OSError(error.errno, error.strerror, "standard output") from None
            return memoryview(data).nbytes


def stream_writer(number: int, like: TextIO | None = None, encoding: str = "utf-8") -> TextIO:
    """Return a text stream to a descriptor, buffered and encoded as ``like`` is; its reader may leave."""
    raw = _ForLeavingReaders(number, "w", closefd=number > 2)
    if not isinstance(like, io.TextIOWrapper):
        return io.TextIOWrapper(io.BufferedWriter(raw), encoding, "backslashreplace")
    unbuffered = isinstance(like.buffer, io.RawIOBase)  # python -u
    return io.TextIOWrapper(
        raw if unbuffered else io.BufferedWriter(raw),
        like.encoding,
        like.errors,
        line_buffering=like.line_buffering,
        write_through=like.write_through,
    )


def prepare_streams() -> None:
    """Open the null device for each closed standard stream, and let the readers of the others leave.

    To be called first of all, before another file takes the descriptor of a closed stream.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
            os.set_inheritable(number, True)
    if sys.stdin is None:
        sys.stdin = open(0, closefd=False)  # noqa: SIM115  # as long as the process
    sys.stdout, sys.stderr = stream_writer(1, sys.stdout), stream_writer(2, sys.stderr)


def leave(code: int) -> NoReturn:
    """End a program that has nothing left to do; its output is written first.

    Python would unload all that was loaded: seconds on a busy machine, while others wait for the end.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # the disk is full
            stream.flush()
    os._exit(code)
