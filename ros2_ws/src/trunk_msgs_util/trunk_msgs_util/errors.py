"""`TrunkError`: the root of all errors that the project's programs show as one line."""

from __future__ import annotations

import os
from traceback import walk_tb

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
