"""`TrunkError`: the root of all errors that the project's programs show as one line."""

from __future__ import annotations

from .text import bounded

EXIT_FAILED = 1  # a run or a check failed
EXIT_USAGE = 2  # an argument, a parameter, a file or a library cannot be used
EXIT_DEFECT = 70  # a defect of ours, with a traceback: EX_SOFTWARE, as 1 and 2 are also verdicts
EXIT_UNREAD = 141  # the reader of what is written has left: what a shell reports of SIGPIPE


class TrunkError(Exception):
    """Something to tell the user, not a defect: the message is one line that says what to do.

    ``exit_code`` is the process's exit code. A subclass also derives from a built-in exception
    if callers that do not know this family are to catch it.
    """

    exit_code: int = EXIT_USAGE

    def __str__(self) -> str:
        return bounded(super().__str__())


class RecordingError(TrunkError):
    """The file cannot be used as a recording: one line that names it and says what to do."""
