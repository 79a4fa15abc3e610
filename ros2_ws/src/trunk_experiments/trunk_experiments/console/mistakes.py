"""What went wrong, as one line on stderr."""

from __future__ import annotations

import errno
import sys

from trunk_msgs_util.errors import EXIT_USAGE, TrunkError

_ELSEWHERE = ": give a writable place"
_ADVICE = {
    errno.ENOSPC: ": free some space, or give another place",
    errno.EDQUOT: ": free some space, or give another place",
    errno.EROFS: _ELSEWHERE,
    errno.EACCES: _ELSEWHERE,
    errno.EPERM: _ELSEWHERE,
    errno.ENOTDIR: ": part of this path is a file; give another place",
}


def line_of(error: Exception) -> str:
    """Return an error as one line that says what to do."""
    text = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename}: {error.strerror}{_ADVICE.get(error.errno or 0, '')}"
    return " ".join(text.split())


def say(text: str) -> str:
    """Print a mistake to stderr; return it as one line."""
    line = " ".join(text.split())
    print(f"trunk: error: {line}", file=sys.stderr)
    return line


def tell(error: TrunkError | OSError) -> int:
    """Print an error to stderr; return the exit code."""
    say(line_of(error))
    return error.exit_code if isinstance(error, TrunkError) else EXIT_USAGE
