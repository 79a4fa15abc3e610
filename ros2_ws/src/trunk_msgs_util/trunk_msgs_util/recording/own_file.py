"""The file that is being written: locked against a second writer, and still the one that its path names."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from errno import ENOENT, ESTALE
from pathlib import Path
from stat import S_ISREG
from typing import BinaryIO


def open_own(path: Path, *, overwrite: bool) -> BinaryIO:
    """Create a file, or empty the one that is there, and lock it until it is closed.

    Raises FileExistsError where it exists, unless ``overwrite``, and BlockingIOError where another process is
    writing it: then it is left as it is. The lock ends with its process; a leftover file has none.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | (0 if overwrite else os.O_EXCL)
    try:
        number = os.open(path, flags, 0o666)
    except FileExistsError:
        raise FileExistsError(f"{path} exists: choose another name, or overwrite it") from None
    file = open(number, "wb")  # noqa: PTH123, SIM115  a descriptor; the caller closes it
    try:
        _lock(file, path)
        if S_ISREG(os.fstat(number).st_mode):
            file.truncate(0)
    except OSError:
        file.close()
        raise
    return file


def is_being_written(path: Path) -> bool:
    """Return True if a process holds the lock of a file. Raises OSError where it cannot be opened."""
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # this file system has no locks
            pass
    return False


def _lock(file: BinaryIO, path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BlockingIOError(
            f"{path} is being written by another process: choose another name, or stop that one"
        ) from None
    except OSError:  # this file system has no locks
        pass


def check_own(file: BinaryIO, path: Path) -> None:
    """Raise OSError where ``path`` no longer names this file, or another process has changed its size."""
    here = os.fstat(file.fileno())
    if not S_ISREG(here.st_mode):  # a terminal or a device
        return
    there = None
    with suppress(FileNotFoundError, NotADirectoryError):
        there = path.stat()
    if there is None:
        # Some file systems (NFS, an overlay by FUSE) still count a link to a file that is deleted.
        how = "renamed or deleted" if here.st_nlink else "deleted"
        raise FileNotFoundError(ENOENT, f"it has been {how}")
    if (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino):
        raise OSError(ESTALE, "another file has been put in its place")
    written = os.lseek(file.fileno(), 0, os.SEEK_CUR)  # what is still buffered does not count
    if here.st_size != written:
        how = "truncated" if here.st_size < written else "written to by another process"
        raise OSError(ESTALE, f"it has been {how}")
