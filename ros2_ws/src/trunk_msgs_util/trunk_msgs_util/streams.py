"""The three standard streams of a program: open, and written to without harm when their reader has left.

Without this, a program that is started with a closed stream (``>&-``) fails at its first line, or its
next file or socket takes the stream's descriptor and receives what is printed.
"""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress
from typing import Any, NoReturn, TextIO


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


def writer(number: int, like: TextIO | None = None, encoding: str = "utf-8") -> TextIO:
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


def prepare() -> None:
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
    sys.stdout, sys.stderr = writer(1, sys.stdout), writer(2, sys.stderr)


def leave(code: int) -> NoReturn:
    """End a program that has nothing left to do; its output is written first.

    Python would unload all that was loaded: seconds on a busy machine, while others wait for the end.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # the disk is full
            stream.flush()
    os._exit(code)
