"""`TrunkError`, the root of all errors that the project's programs show as one line, and its family.

Which name was meant, and how warnings are shown.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable
from signal import Signals
from traceback import walk_tb
from typing import Any

from .text import bounded, shortened

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


class SettingError(TrunkError):
    """A setting of the environment that cannot be used: its name, its value, what is allowed."""


class PlanError(TrunkError):
    """A run that is not possible: what is wrong, its value, what is allowed."""


class TuningError(PlanError):
    """A tuning that is not possible: why, and what to give instead."""


class StudyError(PlanError):
    """A study that cannot be used: file, place, value, what is allowed."""


class RuleFileError(TrunkError):
    """A rule file that cannot be read or taken over: file, place, what is allowed."""


class DrawError(TrunkError):
    """A distribution whose parameters are not possible."""


class ExecutableError(TrunkError):
    """A node's executable that is not installed."""


class NotInstalledError(TrunkError, ImportError):
    """An optional library that is not installed, and how to install it."""


class ActionError(TrunkError, ValueError):
    """An action that an environment cannot take: its value, what is allowed."""


class LibraryError(TrunkError):
    """A library that this needs is not installed: which one, and how to install it."""


class RunError(TrunkError):
    """A run that did not end as it should: which part of it, and why."""

    exit_code = EXIT_FAILED


class StoppedError(RunError):
    """A run that was told to stop, by a signal's name or another, before its end."""

    def __init__(self, by: str, note: str) -> None:
        super().__init__(f"stopped by {by}{note}")
        if by in Signals.__members__:
            self.exit_code = 128 + Signals[by]


class SweepError(RunError):
    """A sweep that went wrong while it ran."""


class LiveParametersError(TrunkError):
    """A running node that is missing, does not answer, or refuses."""

    exit_code = EXIT_FAILED


class GatewayError(TrunkError):
    """The gateway between a page and a run cannot work: why, and what to do."""

    exit_code = EXIT_FAILED


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is most like ``name``, whatever its case; empty if none is."""
    from difflib import get_close_matches  # needed after a mistake

    by_lower = {candidate.lower(): candidate for candidate in known}
    matches = get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[matches[0]] if matches else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'fig6'?``, or nothing where no known name is like it."""
    meant = closest(name, known)
    return f"; did you mean {meant!r}?" if meant else ""


def show_warnings_plainly() -> None:
    """Show Python's warnings as one line each on stderr, like the command's own."""

    def show(message: Warning | str, *_more: Any, **_named: Any) -> None:
        print(f"trunk: warning: {bounded(str(message))}", file=sys.stderr)

    warnings.showwarning = show


# By the beginnings of their names: what libraries read while they are loaded.
_SETTINGS = {
    "matplotlib": ("MPL", "MATPLOTLIB"),
    "numba": ("NUMBA_",),
    "numpy": ("NPY_", "NUMPY_"),
}


def unusable_setting(error: BaseException) -> str:
    """Return in one line which settings keep a library from being loaded; empty for any other error."""
    loading = [
        str(frame.f_globals.get("__name__")).partition(".")[0]
        for frame, _ in walk_tb(error.__traceback__)
        if frame.f_code.co_name == "<module>"
    ]
    library = next((name for name in loading if name in _SETTINGS), "")
    if not library or isinstance(error, ImportError):
        return ""
    given = [f"{k}={v}" for k, v in sorted(os.environ.items()) if k.startswith(_SETTINGS[library])]
    why = shortened(" ".join(str(error).partition("\nThe parse")[0].split()).rstrip("."), 200)
    return f"{library} cannot use {', '.join(given) or 'its settings file'}: {why}; correct or unset it"
