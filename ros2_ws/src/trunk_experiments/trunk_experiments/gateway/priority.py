"""A process that gives way to all others, so that what it shows is not slowed by being shown."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

_LEAST = 19
# Linux shares the processors among sessions first, and only within one by the processes' own priorities.
_OF_THE_SESSION = Path("/proc/self/autogroup")


def give_way() -> None:
    """Give this process, and its session, which it must have for itself, the lowest priority."""
    with suppress(OSError):
        os.nice(_LEAST)
    with suppress(OSError):
        _OF_THE_SESSION.write_text(str(_LEAST), "ascii")
