"""`TrunkError`: the root of all errors that the project's programs show as one line."""

from __future__ import annotations

from typing import ClassVar

EXIT_FAILED = 1  # a run or a check failed
EXIT_USAGE = 2  # an argument, a parameter or a file cannot be used


class TrunkError(Exception):
    """Something to tell the user, not a defect: the message is one line that says what to do.

    ``exit_code`` is the process's exit code. A subclass also derives from a built-in exception
    if callers that do not know this family are to catch it.
    """

    exit_code: ClassVar[int] = EXIT_USAGE
